//! S3, Google Cloud Storage and Azure Blob Storage by the crate `object_store`, which takes keys and endpoints from the
//! environment, signs requests and tries again, with growing pauses, what fails in passing.

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

use super::{Address, Cause, Entry, Store, StoreError};
use crate::hash::hex;

/// Bytes of a file that go in one request; of a larger file in several, all alike but the last, as some stores want it.
/// S3 takes 10,000 of them.
const PART: u64 = 16 << 20;

/// How often a waiting thread looks whether it shall stop.
const LOOK: Duration = Duration::from_millis(50);

/// For a request of a run: a store that is away for about a minute is waited for.
fn patient() -> RetryConfig {
    let backoff =
        BackoffConfig { init_backoff: Duration::from_millis(200), max_backoff: Duration::from_secs(20), base: 3.0 };
    RetryConfig { backoff, max_retries: 12, retry_timeout: Duration::from_secs(180) }
}

/// For the first request: who mistyped an address does not wait.
fn hasty() -> RetryConfig {
    RetryConfig { max_retries: 3, retry_timeout: Duration::from_secs(5), ..RetryConfig::default() }
}

/// A store, and the thread that talks to it.
pub struct Objects<'a> {
    address: Address,
    /// What names begin with in the store.
    prefix: String,
    store: Arc<dyn ObjectStore>,
    /// The same with less patience.
    first: Arc<dyn ObjectStore>,
    runtime: Runtime,
    stop: &'a AtomicBool,
}

impl<'a> Objects<'a> {
    /// The store at an address, which nobody has talked to yet. Whatever waits for it ends soon after `stop` is raised.
    pub fn open(address: &Address, stop: &'a AtomicBool) -> io::Result<Self> {
        // Whoever was first, it is this one.
        let _ = rustls::crypto::ring::default_provider().install_default();
        // One thread keeps connections alive while nobody asks for anything.
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let wrong = |error: Error| io::Error::other(explained(&error, address.scheme));
        let [store, first] = [patient(), hasty()].map(|retry| connect(address, retry));
        let prefix = if address.scheme == "file" { String::new() } else { address.prefix.clone() };
        let (store, first) = (store?.map_err(wrong)?, first?.map_err(wrong)?);
        Ok(Self { address: address.clone(), prefix, store, first, runtime, stop })
    }

    /// An object's name in the store.
    fn name(&self, name: &str) -> io::Result<Name> {
        let whole =
            [self.prefix.as_str(), name].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("/");
        Name::parse(&whole).map_err(|error| self.failed(&error.into()))
    }

    /// An object's name from the address.
    fn below(&self, name: &Name) -> String {
        let whole = name.as_ref();
        whole.strip_prefix(&self.prefix).unwrap_or(whole).trim_start_matches('/').to_owned()
    }

    fn entry(&self, meta: ObjectMeta) -> Entry {
        (self.below(&meta.location), meta.size)
    }

    fn failed(&self, error: &Error) -> io::Error {
        io::Error::other(explained(error, self.address.scheme))
    }

    /// Waits for an answer, or for the wish to stop.
    fn wait<T>(&self, answer: impl Future<Output = Result<T, Error>>) -> io::Result<T> {
        let stopped = async {
            while !self.stop.load(Ordering::Relaxed) {
                tokio::time::sleep(LOOK).await;
            }
        };
        match self.runtime.block_on(select(pin!(answer), pin!(stopped))) {
            Either::Left((answer, _)) => answer.map_err(|error| self.failed(&error)),
            Either::Right(_) => {
                let said = String::from("stopped");
                Err(io::Error::other(StoreError { cause: Cause::Stopped, said, scheme: self.address.scheme }))
            }
        }
    }

    /// Puts a file in parts.
    fn put_parts(&self, name: &Name, mut file: File) -> io::Result<()> {
        let mut upload = self.wait(self.store.put_multipart(name))?;
        let mut send = || {
            loop {
                let part = read_part(&mut file)?;
                if part.is_empty() {
                    return self.wait(upload.complete()).map(drop);
                }
                let sent = upload.put_part(part.into());
                self.wait(sent)?;
            }
        };
        let sent = send();
        if sent.is_err() {
            // Parts that belong to nothing are paid for. A store that is away, or who is to stop at once, leaves them.
            let soon = async { tokio::time::timeout(Duration::from_secs(5), upload.abort()).await };
            let _ = self.runtime.block_on(soon);
        }
        sent
    }
}

/// The next bytes of a file; none at its end.
fn read_part(file: &mut File) -> io::Result<Vec<u8>> {
    let mut part = Vec::new();
    file.take(PART).read_to_end(&mut part)?;
    Ok(part)
}

/// The crate's store for an address. The outer error is this machine's.
fn connect(address: &Address, retry: RetryConfig) -> io::Result<Result<Arc<dyn ObjectStore>, Error>> {
    let bucket = address.bucket.as_str();
    let store: Result<Arc<dyn ObjectStore>, Error> = match address.scheme {
        "s3" => {
            let builder = AmazonS3Builder::from_env().with_bucket_name(bucket).with_retry(retry);
            // Who writes http:// means it.
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

impl Store for Objects<'_> {
    fn address(&self, name: &str) -> String {
        let slash = if name.is_empty() { "" } else { "/" };
        format!("{}{slash}{name}", self.address)
    }

    fn top(&self) -> io::Result<(Vec<Entry>, Vec<String>)> {
        let prefix = self.name("")?;
        let listed = self.wait(self.first.list_with_delimiter(Some(&prefix)))?;
        let folders = listed.common_prefixes.iter().map(|folder| self.below(folder)).collect();
        // Some programs put an empty object for a folder.
        let objects = listed.objects.into_iter().map(|meta| self.entry(meta)).filter(|(name, _)| !name.is_empty());
        Ok((objects.collect(), folders))
    }

    fn list(&self, folder: &str) -> io::Result<Vec<Entry>> {
        let prefix = self.name(folder)?;
        let mut listed = self.store.list(Some(&prefix));
        let mut found = Vec::new();
        loop {
            match self.wait(listed.try_next())? {
                Some(meta) => found.push(self.entry(meta)),
                None => return Ok(found),
            }
        }
    }

    fn get(&self, name: &str, most: u64) -> io::Result<Option<Vec<u8>>> {
        let name = self.name(name)?;
        let got = async {
            match self.store.get(&name).await {
                Ok(found) if found.meta.size <= most => found.bytes().await.map(|bytes| Some(Ok(bytes.into()))),
                Ok(found) => Ok(Some(Err(found.meta.size))),
                Err(error) if is_absent(&error) => Ok(None),
                Err(error) => Err(error),
            }
        };
        let found: Option<Result<Vec<u8>, u64>> = self.wait(got)?;
        let too_large = |size| io::Error::other(format!("has {size} bytes, more than {most}"));
        found.map(|found| found.map_err(too_large)).transpose()
    }

    fn digest(&self, name: &str) -> io::Result<Option<(u64, String)>> {
        let name = self.name(name)?;
        let (mut hash, mut read) = (Sha256::new(), 0);
        let length = match self.wait(async { Ok(self.store.head(&name).await) })? {
            Ok(meta) => meta.size,
            Err(error) if is_absent(&error) => return Ok(None),
            Err(error) => return Err(self.failed(&error)),
        };
        while read < length {
            let bytes = self.wait(self.store.get_range(&name, read..length.min(read + PART)))?;
            if bytes.is_empty() {
                return Err(io::Error::other("ends before its length"));
            }
            read += bytes.len() as u64;
            hash.update(&bytes);
        }
        Ok(Some((length, hex(&hash.finalize()))))
    }

    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()> {
        let name = self.name(name)?;
        self.wait(self.store.put(&name, PutPayload::from(bytes))).map(drop)
    }

    fn put_new(&self, name: &str, bytes: Vec<u8>) -> io::Result<bool> {
        let name = self.name(name)?;
        let (new, anyway) = (PutPayload::from(bytes.clone()), PutPayload::from(bytes));
        let put = async {
            match self.store.put_opts(&name, new, PutMode::Create.into()).await {
                Ok(_) => Ok(true),
                Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => Ok(false),
                Err(Error::NotImplemented { .. } | Error::NotSupported { .. }) => {
                    self.store.put(&name, anyway).await.map(|_| true)
                }
                Err(error) => Err(error),
            }
        };
        self.wait(put)
    }

    fn put_file(&self, name: &str, file: &Path) -> io::Result<()> {
        let name = self.name(name)?;
        let mut file = File::open(file)?;
        if file.metadata()?.len() > PART {
            return self.put_parts(&name, file);
        }
        let whole = read_part(&mut file)?;
        self.wait(self.store.put(&name, whole.into())).map(drop)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        let name = self.name(name)?;
        let removed = async {
            match self.store.delete(&name).await {
                Err(error) if !is_absent(&error) => Err(error),
                _ => Ok(()),
            }
        };
        self.wait(removed)
    }
}

/// True if there is no such object; not if there is no such bucket.
fn is_absent(error: &Error) -> bool {
    matches!(error, Error::NotFound { .. }) && cause(error) != Cause::NoBucket
}

fn explained(error: &Error, scheme: &'static str) -> StoreError {
    StoreError { cause: cause(error), said: said(error), scheme }
}

/// Codes by which stores name their errors, and what they mean. Each is a word of the text.
const CODES: [(&str, Cause); 18] = [
    ("NoSuchBucket", Cause::NoBucket),
    ("ContainerNotFound", Cause::NoBucket),
    ("The specified bucket does not exist", Cause::NoBucket),
    ("AuthorizationHeaderMalformed", Cause::Region),
    ("PermanentRedirect", Cause::Region),
    ("redirect without LOCATION", Cause::Region),
    ("IllegalLocationConstraint", Cause::Region),
    ("AccessDenied", Cause::Denied),
    ("InvalidAccessKeyId", Cause::Denied),
    ("SignatureDoesNotMatch", Cause::Denied),
    ("ExpiredToken", Cause::Denied),
    ("401 Unauthorized", Cause::Denied),
    ("403 Forbidden", Cause::Denied),
    ("QuotaExceeded", Cause::Full),
    ("InsufficientStorage", Cause::Full),
    ("StorageFull", Cause::Full),
    ("507 Insufficient", Cause::Full),
    ("No space left", Cause::Full),
];

fn cause(error: &Error) -> Cause {
    let text = whole(error);
    if let Some((_, cause)) = CODES.iter().find(|(code, _)| text.contains(code)) {
        return *cause;
    }
    if matches!(error, Error::PermissionDenied { .. } | Error::Unauthenticated { .. }) {
        return Cause::Denied;
    }
    let mut inner = error.source();
    while let Some(error) = inner {
        if let Some(http) = error.downcast_ref::<HttpError>() {
            let kinds =
                [HttpErrorKind::Connect, HttpErrorKind::Request, HttpErrorKind::Timeout, HttpErrorKind::Interrupted];
            return if kinds.contains(&http.kind()) { Cause::Unreachable } else { Cause::Other };
        }
        if let Some(io) = error.downcast_ref::<io::Error>() {
            return match io.kind() {
                io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => Cause::Denied,
                io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Cause::Full,
                _ => Cause::Other,
            };
        }
        inner = error.source();
    }
    Cause::Other
}

/// The error and what is beneath it, but what a text before has said.
fn whole(error: &Error) -> String {
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

/// The same in the store's own words where it has sent a code and a message.
fn said(error: &Error) -> String {
    let text = whole(error);
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
