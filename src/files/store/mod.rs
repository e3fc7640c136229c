//! Object stores, as far as a dataset needs one: complete objects below an address are put, read, listed and removed.
//!
//! `remote.rs`, behind the cargo feature `stores`, talks to a store. Addresses are recognised without it.

use std::fmt;
use std::io;
use std::path::Path;
use std::sync::atomic::AtomicBool;

#[cfg(feature = "stores")]
pub mod remote;

/// The schemes of store addresses, and the names of their stores.
const SCHEMES: [(&str, &str); 4] = [
    ("s3", "S3"),
    ("gs", "Google Cloud Storage"),
    ("az", "Azure Blob Storage"),
    ("file", "a folder, taken for a store"),
];

/// The parts of an address such as `s3://bucket/prefix`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoreAddress {
    /// One of `s3`, `gs`, `az` and `file`.
    pub scheme: &'static str,
    /// The bucket or container; empty for `file`.
    pub bucket: String,
    /// The prefix of the names of all objects, without slashes around it; for `file` the folder's path.
    pub prefix: String,
}

impl StoreAddress {
    /// Parses an address. Returns `None` for a path. The error says what addresses look like.
    pub fn parse(text: &str) -> Option<Result<Self, String>> {
        let (scheme, rest) = text.split_once("://")?;
        let is_scheme = |c: char| c.is_ascii_alphanumeric() || "+.-".contains(c);
        if !scheme.starts_with(|c: char| c.is_ascii_alphabetic()) || !scheme.chars().all(is_scheme) {
            return None;
        }
        let Some(&(scheme, _)) = SCHEMES.iter().find(|(known, _)| scheme.eq_ignore_ascii_case(known)) else {
            let known: Vec<String> = SCHEMES.iter().map(|(scheme, store)| format!("{scheme}:// ({store})")).collect();
            return Some(Err(format!("{scheme}:// is no store that is known: {}", known.join(", "))));
        };
        if scheme == "file" {
            let absolute = rest.starts_with('/') && !rest.trim_matches('/').is_empty();
            let wrong = "write a file:// address with three slashes and the full path: file:///data/presses";
            return Some(if absolute { Ok(Self::new(scheme, "", rest)) } else { Err(String::from(wrong)) });
        }
        let (bucket, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        if bucket.is_empty() {
            return Some(Err(format!("{text} names no bucket: write {scheme}://BUCKET/PREFIX")));
        }
        let prefix = prefix.trim_matches('/');
        if prefix.split('/').any(|part| [".", ".."].contains(&part)) || prefix.contains("//") {
            return Some(Err(format!("{text} has an empty name, `.` or `..` between its slashes")));
        }
        Some(Ok(Self::new(scheme, bucket, prefix)))
    }

    fn new(scheme: &'static str, bucket: &str, prefix: &str) -> Self {
        Self { scheme, bucket: bucket.to_owned(), prefix: prefix.to_owned() }
    }

    /// Returns true if a path has the form of an address, valid or not.
    pub fn is_address(path: &Path) -> bool {
        path.to_str().and_then(Self::parse).is_some()
    }
}

/// Explains why a path cannot be meant as a place to write to: it is the address of a store with a slash too few, or
/// has something that a shell should have replaced. Without this check, a folder of that name would be made. Returns
/// `None` for any other path.
pub fn explain_mistaken_output(path: &Path) -> Option<String> {
    let text = path.to_str()?;
    if text.is_empty() {
        return Some(String::from("it is empty: name a folder, or leave it out"));
    }
    if let Some((scheme, rest)) = text.split_once(":/").filter(|(_, rest)| !rest.starts_with('/')) {
        let known =
            SCHEMES.iter().map(|(known, _)| *known).chain(["azure", "gcs", "http", "https", "r2", "hdfs", "abfs"]);
        if known.into_iter().any(|known| scheme.eq_ignore_ascii_case(known)) {
            let slashes = if scheme.eq_ignore_ascii_case("file") { "///" } else { "//" };
            let folder = format!("a folder of that name is ./{text}");
            return Some(format!("an address has two slashes: {scheme}:{slashes}{rest}; {folder}"));
        }
    }
    if text == "~" || text.starts_with("~/") {
        return Some(format!("no shell has replaced the ~ in it: write it without quotes, or \"$HOME{}\"", &text[1..]));
    }
    if text.starts_with('$') || text.starts_with("%") {
        return Some(String::from(
            "no shell has replaced the variable in it: write it in double quotes, or the path itself",
        ));
    }
    None
}

impl fmt::Display for StoreAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scheme, bucket, prefix } = self;
        let slash = if bucket.is_empty() || prefix.is_empty() { "" } else { "/" };
        write!(f, "{scheme}://{bucket}{slash}{prefix}")
    }
}

/// Why a store failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoreFailure {
    /// The store does not answer after all retries.
    Unreachable,
    /// There is no such bucket.
    NoBucket,
    /// The keys are missing or wrong, or do not allow this.
    Denied,
    /// The bucket is in another region.
    WrongRegion,
    /// The store has no more room.
    Full,
    /// The caller raised `stop`.
    Stopped,
    /// Anything else.
    Other,
}

/// An error of a store, held in an [`io::Error`].
#[derive(Debug)]
pub struct StoreError {
    /// What kind of failure it is.
    pub cause: StoreFailure,
    /// The message of the store.
    pub message: String,
    /// `s3`, `gs`, `az` or `file`.
    pub scheme: &'static str,
}

impl StoreError {
    /// Returns what to do: half a sentence, or an empty text if nothing is known.
    pub fn help(&self) -> &'static str {
        match (self.cause, self.scheme) {
            (StoreFailure::Unreachable, "s3") => {
                "check the network and AWS_ENDPOINT_URL; without AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY keys are asked of \
                 the machine's own service, which only clouds have; "
            }
            (StoreFailure::Unreachable, _) => "check the network and the address; ",
            (StoreFailure::NoBucket, "az") => "make the container first, or name another one; ",
            (StoreFailure::NoBucket, _) => "make the bucket first, or name another one; ",
            (StoreFailure::Denied, "s3") => {
                "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_SESSION_TOKEN, and that they may list, get, put and \
                 delete there (keys in ~/.aws are not read; `aws configure export-credentials --format env` prints them); "
            }
            (StoreFailure::Denied, "gs") => {
                "check GOOGLE_APPLICATION_CREDENTIALS, and that its account may list, get, create and delete there; "
            }
            (StoreFailure::Denied, "az") => {
                "check AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY, and that they may list, read, write and delete there; "
            }
            (StoreFailure::Denied, _) => "make the folder writable, or name another one; ",
            (StoreFailure::WrongRegion, _) => "set AWS_REGION to the bucket's region; ",
            (StoreFailure::Full, _) => "make room there, or raise the quota; ",
            (StoreFailure::Stopped | StoreFailure::Other, _) => "",
        }
    }
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for StoreError {}

/// Returns the store's error inside an [`io::Error`], if there is one.
pub fn find_store_error(error: &io::Error) -> Option<&StoreError> {
    error.get_ref()?.downcast_ref()
}

/// The name of an object, relative to the store's address, and its size in bytes.
pub type StoreEntry = (String, u64);

/// Access to the objects below one address. Names are relative to it, with `/` between folders. Errors hold a
/// [`StoreError`], unless a file on this machine could not be read.
pub trait Store: Sync {
    /// Returns the full address of an object; for the empty name, that of the store.
    fn full_address(&self, name: &str) -> String;

    /// Lists the objects right below the address, and the names of the folders there.
    fn list_top(&self) -> io::Result<(Vec<StoreEntry>, Vec<String>)>;

    /// Lists all objects in a folder and in its subfolders.
    fn list(&self, folder: &str) -> io::Result<Vec<StoreEntry>>;

    /// Reads an object. Returns `None` if it does not exist. It is an error if it has more than `most` bytes.
    fn get(&self, name: &str, most: u64) -> io::Result<Option<Vec<u8>>>;

    /// Returns the number of bytes and the SHA-256 of an object, or `None` if it does not exist. Reads all of it, but
    /// holds only a part at a time.
    fn digest(&self, name: &str) -> io::Result<Option<(u64, String)>>;

    /// Writes an object and replaces what is there. At every instant either the old or the new object is there,
    /// complete.
    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()>;

    /// Writes an object if none has this name. Returns false if there is one, whoever wrote it. A store that cannot
    /// tell replaces it.
    fn put_new(&self, name: &str, bytes: Vec<u8>) -> io::Result<bool>;

    /// Writes a file as [`Self::put`] does, but holds only a part of it in memory at a time.
    fn put_file(&self, name: &str, file: &Path) -> io::Result<()>;

    /// Removes an object, if it exists.
    fn remove(&self, name: &str) -> io::Result<()>;
}

/// Whether this program is built with access to stores.
pub const HAS_STORES: bool = cfg!(feature = "stores");

/// Opens the store at an address, without contacting it yet. Any call that waits for it ends soon after `stop` is
/// raised.
pub fn open_store<'a>(address: &StoreAddress, stop: &'a AtomicBool) -> io::Result<Box<dyn Store + 'a>> {
    #[cfg(feature = "stores")]
    return remote::RemoteStore::open(address, stop).map(|store| Box::new(store) as _);
    #[cfg(not(feature = "stores"))]
    {
        let _ = stop;
        Err(io::Error::new(io::ErrorKind::Unsupported, format!("{address}: built without the feature `stores`")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_told_from_paths_and_taken_apart() {
        for path in ["out/presses", "/data", "s3:/bucket", "://x", "a b://c", "1s://x", "", "s3"] {
            assert_eq!(StoreAddress::parse(path), None, "{path}");
        }
        let sound = [
            ("s3://bucket/a/b/", "s3://bucket/a/b"),
            ("S3://bucket", "s3://bucket"),
            ("gs://b/p", "gs://b/p"),
            ("az://container/p?x#y", "az://container/p?x#y"),
            ("file:///data/presses", "file:///data/presses"),
        ];
        for (text, shown) in sound {
            let address = StoreAddress::parse(text).expect("an address").expect("sound");
            assert_eq!(address.to_string(), shown);
            assert_eq!(StoreAddress::parse(shown), Some(Ok(address)), "what is shown is an address");
        }
        for wrong in
            ["s3://", "s3:///p", "http://host/p", "file://data", "file:///", "s3://b/a//c", "s3://b/../c", "gs://b/."]
        {
            assert!(matches!(StoreAddress::parse(wrong), Some(Err(_))), "{wrong}");
        }
    }
}
