//! Object stores, as far as a dataset needs one: whole objects below an address, put, read, listed and removed.
//!
//! What talks to a store is `objects.rs`, which the cargo feature `stores` brings; addresses are recognised without it.

use std::fmt;
use std::io;
use std::path::Path;
use std::sync::atomic::AtomicBool;

#[cfg(feature = "stores")]
pub mod objects;

/// What addresses of stores begin with, and what the store is called.
const SCHEMES: [(&str, &str); 4] = [
    ("s3", "S3"),
    ("gs", "Google Cloud Storage"),
    ("az", "Azure Blob Storage"),
    ("file", "a folder, taken for a store"),
];

/// An address as a user writes it, taken apart: `s3://bucket/prefix`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// One of `s3`, `gs`, `az` and `file`.
    pub scheme: &'static str,
    /// The bucket, or container; empty of `file`.
    pub bucket: String,
    /// What the names of all objects begin with, without slashes around it; of `file` the folder's path.
    pub prefix: String,
}

impl Address {
    /// Takes an address apart; `None` of what is a path. The error says what addresses look like.
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
            let wrong = "write a file:// address with three slashes and the whole path: file:///data/presses";
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

    /// True if a path is an address, sound or not.
    pub fn is_one(path: &Path) -> bool {
        path.to_str().and_then(Self::parse).is_some()
    }
}

/// Why a path cannot be what is meant as a place to write to: the address of a store with a slash too few, or what a shell would
/// have replaced. Left alone, it would be a folder of that name.
pub fn mistaken_output(path: &Path) -> Option<String> {
    let text = path.to_str()?;
    if text.is_empty() {
        return Some(String::from("it is empty: name a folder, or leave --out out"));
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

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scheme, bucket, prefix } = self;
        let slash = if bucket.is_empty() || prefix.is_empty() { "" } else { "/" };
        write!(f, "{scheme}://{bucket}{slash}{prefix}")
    }
}

/// Why a store did not do what it was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// The store does not answer, after all tries.
    Unreachable,
    /// There is no such bucket.
    NoBucket,
    /// No keys, wrong ones, or such as may not do this.
    Denied,
    /// The bucket is in another region.
    Region,
    /// The store takes no more.
    Full,
    /// Who waited for it wants to end.
    Stopped,
    /// Anything else.
    Other,
}

/// What a store said, in the words of an [`io::Error`] that holds this.
#[derive(Debug)]
pub struct StoreError {
    /// What kind of failure it is.
    pub cause: Cause,
    /// What the store said.
    pub said: String,
    /// `s3`, `gs`, `az` or `file`.
    pub scheme: &'static str,
}

impl StoreError {
    /// What to do about it: half a sentence; empty where nothing is known.
    pub fn way_out(&self) -> &'static str {
        match (self.cause, self.scheme) {
            (Cause::Unreachable, "s3") => {
                "check the network and AWS_ENDPOINT_URL; without AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY keys are asked of \
                 the machine's own service, which only clouds have; "
            }
            (Cause::Unreachable, _) => "check the network and the address; ",
            (Cause::NoBucket, "az") => "make the container first, or name another one; ",
            (Cause::NoBucket, _) => "make the bucket first, or name another one; ",
            (Cause::Denied, "s3") => {
                "check AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_SESSION_TOKEN, and that they may list, get, put and \
                 delete there (keys in ~/.aws are not read; `aws configure export-credentials --format env` prints them); "
            }
            (Cause::Denied, "gs") => {
                "check GOOGLE_APPLICATION_CREDENTIALS, and that its account may list, get, create and delete there; "
            }
            (Cause::Denied, "az") => {
                "check AZURE_STORAGE_ACCOUNT_NAME and AZURE_STORAGE_ACCOUNT_KEY, and that they may list, read, write and delete there; "
            }
            (Cause::Denied, _) => "make the folder writable, or name another one; ",
            (Cause::Region, _) => "set AWS_REGION to the bucket's region; ",
            (Cause::Full, _) => "make room there, or raise the quota; ",
            (Cause::Stopped | Cause::Other, _) => "",
        }
    }
}

impl fmt::Display for StoreError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.said)
    }
}

impl std::error::Error for StoreError {}

/// What a store says in an error, if it is a store's.
pub fn said(error: &io::Error) -> Option<&StoreError> {
    error.get_ref()?.downcast_ref()
}

/// An object below the store's address: its name from there, and its bytes.
pub type Entry = (String, u64);

/// Objects below one address. Names are relative to it, with `/` between folders. Errors hold a [`StoreError`], unless
/// a file on this machine could not be read.
pub trait Store: Sync {
    /// The whole address of an object; of the empty name that of the store.
    fn address(&self, name: &str) -> String;

    /// The objects right below the address, and the names of the folders there.
    fn top(&self) -> io::Result<(Vec<Entry>, Vec<String>)>;

    /// All objects in a folder, those in folders of it, too.
    fn list(&self, folder: &str) -> io::Result<Vec<Entry>>;

    /// The bytes of an object; `None` if it is not there. One of more than `most` bytes is an error.
    fn get(&self, name: &str, most: u64) -> io::Result<Option<Vec<u8>>>;

    /// Bytes and SHA-256 of an object; `None` if it is not there. Reads all of it, and holds a part at a time.
    fn digest(&self, name: &str) -> io::Result<Option<(u64, String)>>;

    /// Puts an object, in place of what is there: at every instant one of the two is there, whole.
    fn put(&self, name: &str, bytes: Vec<u8>) -> io::Result<()>;

    /// Puts an object where none is: false if one was there, by whomever. Where a store cannot tell, it puts.
    fn put_new(&self, name: &str, bytes: Vec<u8>) -> io::Result<bool>;

    /// Puts a file as [`Self::put`] does; holds a part of it at a time.
    fn put_file(&self, name: &str, file: &Path) -> io::Result<()>;

    /// Removes an object, if it is there.
    fn remove(&self, name: &str) -> io::Result<()>;
}

/// True if this program can talk to stores.
pub const BUILT_IN: bool = cfg!(feature = "stores");

/// The store at an address, which nobody has talked to yet. Whatever waits for it ends soon after `stop` is raised.
pub fn open<'a>(address: &Address, stop: &'a AtomicBool) -> io::Result<Box<dyn Store + 'a>> {
    #[cfg(feature = "stores")]
    return objects::Objects::open(address, stop).map(|store| Box::new(store) as _);
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
            assert_eq!(Address::parse(path), None, "{path}");
        }
        let sound = [
            ("s3://bucket/a/b/", "s3://bucket/a/b"),
            ("S3://bucket", "s3://bucket"),
            ("gs://b/p", "gs://b/p"),
            ("az://container/p?x#y", "az://container/p?x#y"),
            ("file:///data/presses", "file:///data/presses"),
        ];
        for (text, shown) in sound {
            let address = Address::parse(text).expect("an address").expect("sound");
            assert_eq!(address.to_string(), shown);
            assert_eq!(Address::parse(shown), Some(Ok(address)), "what is shown is an address");
        }
        for wrong in
            ["s3://", "s3:///p", "http://host/p", "file://data", "file:///", "s3://b/a//c", "s3://b/../c", "gs://b/."]
        {
            assert!(matches!(Address::parse(wrong), Some(Err(_))), "{wrong}");
        }
    }
}
