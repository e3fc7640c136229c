//! Access to S3, Google Cloud Storage and Azure Blob Storage by the crate `object_store`. The crate takes keys and
//! endpoints from the environment, signs requests, and retries, with growing pauses, what fails only for a moment.

use std::error::Error as _;
use std::fs::{self, File};
use std::future::Future;
use std::io::{self, Read};
use std::path::Path;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use futures_util::TryStreamExt;
use futures_util::future::{Either, select};
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::azure::MicrosoftAzureBuilder;
use object_store::client::{HttpError, HttpErrorKind};
use object_store::gcp::GoogleCloudStorageBuilder;
use object_store::local::LocalFileSystem;
use object_store::path::Path as Name;
use object_store::{BackoffConfig, Error, ObjectMeta, ObjectStore, ObjectStoreExt, PutMode, PutPayload, RetryConfig};
use sha2::{Digest, Sha256};
use tokio::runtime::Runtime;

use super::{Store, StoreAddress, StoreEntry, StoreError, StoreFailure};
use crate::hash::to_hex;

/// Most bytes of a file that are sent in one request. A larger file is sent in several parts, all of this size but the
/// last, as some stores require. S3 takes 10,000 parts.
const PART_BYTES: u64 = 16 << 20;

/// How often a waiting thread checks whether it should stop.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Returns the retries for requests of a run, which waits if a store is away for about a minute.
fn patient_retry() -> RetryConfig {
    let backoff =
        BackoffConfig { init_backoff: Duration::from_millis(200), max_backoff: Duration::from_secs(20), base: 3.0 };
    RetryConfig { backoff, max_retries: 12, retry_timeout: Duration::from_secs(180) }
}

/// Returns the retries for the first request, so that a mistyped address fails soon.
fn hasty_retry() -> RetryConfig {
    RetryConfig { max_retries: 3, retry_timeout: Duration::from_secs(5), ..RetryConfig::default() }
}

/// A store, and the runtime that talks to it.
pub struct RemoteStore<'a> {
    address: StoreAddress,
    /// The prefix of names in the store.
    prefix: String,
    store: Arc<dyn ObjectStore>,
    /// The same store with fewer retries, for the first request.
    hasty_store: Arc<dyn ObjectStore>,
    runtime: Runtime,
    stop: &'a AtomicBool,
}

impl<'a> RemoteStore<'a> {
    /// Opens the store at an address, without contacting it yet. Any call that waits for it ends soon after `stop` is
    /// raised.
    pub fn open(address: &StoreAddress, stop: &'a AtomicBool) -> io::Result<Self> {
        // This fails if a provider is installed already, which is then the same one.
        let _ = rustls::crypto::ring::default_provider().install_default();
        // A thread of its own keeps connections alive between calls.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let wrong = |error: Error| io::Error::other(to_store_error(&error, address.scheme));
        let [store, first] = [patient_retry(), hasty_retry()].map(|retry| connect_store(address, retry));
        let prefix = if address.scheme == "file" { String::new() } else { address.prefix.clone() };
        let (store, first) = (store?.map_err(wrong)?, first?.map_err(wrong)?);
        Ok(Self { address: address.clone(), prefix, store, hasty_store: first, runtime, stop })
    }

    /// Returns an object's full name in the store.
    fn object_name(&self, name: &str) -> io::Result<Name> {
        let whole =
            [self.prefix.as_str(), name].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("/");
        Name::parse(&whole).map_err(|error| self.to_io_error(&error.into()))
    }

    /// Returns an object's name relative to the address.
    fn relative_name(&self, name: &Name) -> String {
        let whole = name.as_ref();
        whole.strip_prefix(&self.prefix).unwrap_or(whole).trim_start_matches('/').to_owned()
    }

    fn to_entry(&self, meta: ObjectMeta) -> StoreEntry {
        (self.relative_name(&meta.location), meta.size)
    }

    fn to_io_error(&self, error: &Error) -> io::Error {
        io::Error::other(to_store_error(error, self.address.scheme))
    }

    /// Waits for an answer, or until `stop` is raised.
    fn wait_for<T>(&self, answer: impl Future<Output = Result<T, Error>>) -> io::Result<T> {
        let stopped = async {
            while !self.stop.load(Ordering::Relaxed) {
                tokio::time::sleep(STOP_POLL_INTERVAL).await;
            }
        };
        match self.runtime.block_on(select(pin!(answer), pin!(stopped))) {
            Either::Left((answer, _)) => answer.map_err(|error| self.to_io_error(&error)),
            Either::Right(_) => {
                let said = String::from("stopped");
                Err(io::Error::other(StoreError {
                    cause: StoreFailure::Stopped,
                    message: said,
                    scheme: self.address.scheme,
                }))
            }
        }
    }

    /// Uploads a file in parts.
    fn upload_parts(&self, name: &Name, mut file: File) -> io::Result<()> {
        let mut upload = self.wait_for(self.store.put_multipart(name))?;
        let mut send = || {
            loop {
                let part = read_part(&mut file)?;
                if part.is_empty() {
                    return self.wait_for(upload.complete()).map(drop);
                }
                let sent = upload.put_part(part.into());
                self.wait_for(sent)?;
            }
        };
        let sent = send();
        if sent.is_err() {
            // Unfinished parts cost money, so try to remove them. A store that is away, or a run that must stop at
            // once, leaves them.
            let soon = async { tokio::time::timeout(Duration::from_secs(5), upload.abort()).await };
            let _ = self.runtime.block_on(soon);
        }
        sent
    }
}

/// Reads the next part of a file; empty at its end.
fn read_part(file: &mut File) -> io::Result<Vec<u8>> {
    let mut part = Vec::new();
    file.take(PART_BYTES).read_to_end(&mut part)?;
    Ok(part)
}

/// Connects to the store at an address. The outer error is one of this machine.
fn connect_store(address: &StoreAddress, retry: RetryConfig) -> io::Result<Result<Arc<dyn ObjectStore>, Error>> {
    let bucket = address.bucket.as_str();
    let store: Result<Arc<dyn ObjectStore>, Error> = match address.scheme {
        "s3" => {
            let builder = AmazonS3Builder::from_env().with_bucket_name(bucket).with_retry(retry);
            // An endpoint with http:// is meant that way.
            let plain =
                builder.get_config_value(&AmazonS3ConfigKey::Endpoint).is_some_and(|url| url.starts_with("http://"));
            let builder = if plain { builder.with_allow_http(true) } else { builder };
            builder.build().map(|store| Arc::new(store) as _)
        }
        "gs" => {
            let builder = GoogleCloudStorageBuilder::from_env().with_bucket_name(bucket).with_retry(retry);
            builder.build().map(|store| Arc::new(store) as _)
        }
        "az" => {
            let builder = MicrosoftAzureBuilder::from_env().with_container_name(bucket).with_retry(retry);
            builder.build().map(|store| Arc::new(store) as _)
        }
        _ => {
            fs::create_dir_all(&address.prefix)?;
            LocalFileSystem::new_with_prefix(&address.prefix).map(|store| Arc::new(store.with_fsync(true)) as _)
        }
    };
    Ok(store)
}

impl Store for RemoteStore<'_> {
    fn full_address(&self, name: &str) -> String {
        let slash = if name.is_empty() { "" } else { "/" };
        format!("{}{slash}{name}", self.address)
    }

    fn list_top(&self) -> io::Result<(Vec<StoreEntry>, Vec<String>)> {
        let prefix = self.object_name("")?;
        let listed = self.wait_for(self.hasty_store.list_with_delimiter(Some(&prefix)))?;
        let folders = listed.common_prefixes.iter().map(|folder| self.relative_name(folder)).collect();
        // Some programs put an empty object in place of a folder.
        let objects = listed.objects.into_iter().map(|meta| self.to_entry(meta)).filter(|(name, _)| !name.is_empty());
        Ok((objects.collect(), folders))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<StoreEntry>> {
        let prefix = self.object_name(folder)?;
        let mut listed = self.store.list(Some(&prefix));
        let mut found = Vec::new();
        loop {
            match self.wait_for(listed.try_next())? {
                Some(meta) => found.push(self.to_entry(meta)),
                None => return Ok(found),
            }
        }
    }

    fn get(&self, name: &str, most: u64) -> io::Result<Option<Vec<u8>>> {
        let name = self.object_name(name)?;
        let got = async {
            match self.store.get(&name).await {
                Ok(found) if found.meta.size <= most => found.bytes().await.map(|bytes| Some(Ok(bytes.into()))),
                Ok(found) => Ok(Some(Err(found.meta.size))),
                Err(error) if is_absent(&error) => Ok(None),
                Err(error) => Err(error),
            }
        };
        let found: Option<Result<Vec<u8>, u64>> = self.wait_for(got)?;
        let too_large = |size| io::Error::other(format!("has {size} bytes, more than {most}"));
        found.map(|found| found.map_err(too_large)).transpose()
    }

    fn digest(&self, name: &str) -> io::Result<Option<(u64, String)>> {
        let name = self.object_name(name)?;
        let (mut hash, mut read) = (Sha256::new(), 0);
        let length = match self.wait_for(async { Ok(self.store.head(&name).await) })? {
            Ok(meta) => meta.size,
            Err(error) if is_absent(&error) => return Ok(None),
            Err(error) => return Err(self.to_io_error(&error)),
        };
        while read < length {
            let bytes = self.wait_for(self.store.get_range(&name, read..length.min(read + PART_BYTES)))?;
            if bytes.is_empty() {
                return Err(io::Error::other("ends before its length"));
            }
            read += bytes.len() as u64;
            hash.update(&bytes);
        }
        Ok(Some((length, to_hex(&hash.finalize()))))
    }

    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()> {
        let name = self.object_name(name)?;
        self.wait_for(self.store.put(&name, PutPayload::from(bytes))).map(drop)
    }

    fn put_new(&self, name: &str, bytes: Vec<u8>) -> io::Result<bool> {
        let name = self.object_name(name)?;
        let (new, anyway) = (PutPayload::from(bytes.clone()), PutPayload::from(bytes));
        let put = async {
            match self.store.put_opts(&name, new, PutMode::Create.into()).await {
                Ok(_) => Ok(true),
                Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => Ok(false),
                // This store cannot check that there is no such object, so it is put anyway.
                Err(Error::NotImplemented { .. } | Error::NotSupported { .. }) => {
                    self.store.put(&name, anyway).await.map(|_| true)
                }
                Err(error) => Err(error),
            }
        };
        self.wait_for(put)
    }

    fn put_file(&self, name: &str, file: &Path) -> io::Result<()> {
        let name = self.object_name(name)?;
        let mut file = File::open(file)?;
        if file.metadata()?.len() > PART_BYTES {
            return self.upload_parts(&name, file);
        }
        let content = read_part(&mut file)?;
        self.wait_for(self.store.put(&name, content.into())).map(drop)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        let name = self.object_name(name)?;
        let removed = async {
            match self.store.delete(&name).await {
                Err(error) if !is_absent(&error) => Err(error),
                _ => Ok(()),
            }
        };
        self.wait_for(removed)
    }
}

/// Returns true if there is no such object. A missing bucket is another error.
fn is_absent(error: &Error) -> bool {
    matches!(error, Error::NotFound { .. }) && classify_error(error) != StoreFailure::NoBucket
}

fn to_store_error(error: &Error, scheme: &'static str) -> StoreError {
    StoreError { cause: classify_error(error), message: extract_store_message(error), scheme }
}

/// Codes by which stores name their errors, and their meanings. Each occurs as a word in the error's text.
const CODES: [(&str, StoreFailure); 18] = [
    ("NoSuchBucket", StoreFailure::NoBucket),
    ("ContainerNotFound", StoreFailure::NoBucket),
    ("The specified bucket does not exist", StoreFailure::NoBucket),
    ("AuthorizationHeaderMalformed", StoreFailure::WrongRegion),
    ("PermanentRedirect", StoreFailure::WrongRegion),
    ("redirect without LOCATION", StoreFailure::WrongRegion),
    ("IllegalLocationConstraint", StoreFailure::WrongRegion),
    ("AccessDenied", StoreFailure::Denied),
    ("InvalidAccessKeyId", StoreFailure::Denied),
    ("SignatureDoesNotMatch", StoreFailure::Denied),
    ("ExpiredToken", StoreFailure::Denied),
    ("401 Unauthorized", StoreFailure::Denied),
    ("403 Forbidden", StoreFailure::Denied),
    ("QuotaExceeded", StoreFailure::Full),
    ("InsufficientStorage", StoreFailure::Full),
    ("StorageFull", StoreFailure::Full),
    ("507 Insufficient", StoreFailure::Full),
    ("No space left", StoreFailure::Full),
];

fn classify_error(error: &Error) -> StoreFailure {
    let text = full_error_text(error);
    if let Some((_, cause)) = CODES.iter().find(|(code, _)| text.contains(code)) {
        return *cause;
    }
    if matches!(error, Error::PermissionDenied { .. } | Error::Unauthenticated { .. }) {
        return StoreFailure::Denied;
    }
    let mut inner = error.source();
    while let Some(error) = inner {
        if let Some(http) = error.downcast_ref::<HttpError>() {
            let kinds =
                [HttpErrorKind::Connect, HttpErrorKind::Request, HttpErrorKind::Timeout, HttpErrorKind::Interrupted];
            return if kinds.contains(&http.kind()) { StoreFailure::Unreachable } else { StoreFailure::Other };
        }
        if let Some(io) = error.downcast_ref::<io::Error>() {
            return match io.kind() {
                io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => StoreFailure::Denied,
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => StoreFailure::Full,
                _ => StoreFailure::Other,
            };
        }
        inner = error.source();
    }
    StoreFailure::Other
}

/// Joins the messages of an error and of its causes, leaving out what was said already.
fn full_error_text(error: &Error) -> String {
    let mut text = error.to_string();
    let mut inner = error.source();
    while let Some(error) = inner {
        let more = error.to_string();
        if !text.contains(&more) {
            text += &format!(": {more}");
        }
        inner = error.source();
    }
    text
}

/// Returns the store's own code and message, if it sent them, else the full text of the error.
fn extract_store_message(error: &Error) -> String {
    let text = full_error_text(error);
    let between = |tag: &str| {
        let (_, rest) = text.split_once(&format!("<{tag}>"))?;
        rest.split_once(&format!("</{tag}>")).map(|(inside, _)| inside.to_owned())
    };
    match (between("Code"), between("Message")) {
        (Some(code), Some(message)) => format!("{code}: {message}"),
        (Some(code), None) => code,
        _ => text,
    }
}
