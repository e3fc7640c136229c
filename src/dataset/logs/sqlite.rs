//! Reads the messages of a bag of ROS 2 that is an SQLite database: two tables, `topics` and `messages`, in the order
//! of their rows.
//!
//! A database is a file of pages. A table is a tree of pages; rows are in its leaves, and the end of a long row is in a
//! list of further pages (<https://www.sqlite.org/fileformat2.html>). Nothing else of SQL is needed, and a C library
//! would be compiled for longer than all that reads logs.

use std::collections::{HashMap, HashSet};

use super::Index;
use super::compression::MAX_CHUNK_BYTES;
use super::fields::Serialization;
use super::store::{Pages, Place, Store};

/// The first bytes of a database.
pub const MAGIC: &[u8] = b"SQLite format 3\0";

/// Bytes of the first page before its tree.
const FILE_HEAD: usize = 100;

/// A row, as far as it is in its leaf.
struct Row<'a> {
    number: u64,
    /// Bytes of the row.
    length: u64,
    local: &'a [u8],
    /// The page on which it goes on; 0 if it does not.
    next: u32,
}

/// A column of a row: its type, and where it is.
#[derive(Clone, Copy)]
struct Column {
    code: u64,
    at: usize,
    length: u64,
}

/// Notes topics, messages and losses of a database.
pub fn scan(file: &mut Store, index: &mut Index) {
    let found = scan_tables(file, index);
    if let Err(reason) = found {
        index.lose_rest(file, 0, reason);
    }
    let mut log = file.path.clone().into_os_string();
    log.push("-wal");
    if let Some(bytes) = std::fs::metadata(&log).ok().map(|known| known.len()).filter(|bytes| *bytes > 0) {
        let path = log.to_string_lossy();
        let how = "sqlite3 FILE.db3 'PRAGMA wal_checkpoint(TRUNCATE)' merges it";
        index.lose(file, file.length, bytes, format!("{path} was not merged into it: {how}"));
    }
}

fn scan_tables(file: &mut Store, index: &mut Index) -> Result<(), String> {
    let mut head = [0; FILE_HEAD];
    if file.read_some(0, &mut head).map_err(|error| error.to_string())? < FILE_HEAD {
        return Err(String::from("the file is cut off within its head"));
    }
    let size = match u16::from_be_bytes([head[16], head[17]]) {
        1 => 1 << 16,
        size => usize::from(size),
    };
    let usable = size.saturating_sub(usize::from(head[20]));
    if !size.is_power_of_two() || size < 512 || usable < 480 {
        return Err(format!("its pages have {size} bytes"));
    }
    let pages = Pages { size, usable };
    file.pages = Some(pages);
    let file = &*file;
    let mut roots = HashMap::new();
    walk(file, index, 1, &mut |_, row, _, _| {
        let columns = columns(row.local)?;
        if columns.len() >= 4 && text(row.local, columns[0])? == "table" {
            roots.insert(text(row.local, columns[1])?.to_owned(), integer(row.local, columns[3])?);
        }
        Ok(())
    });
    let root = |name: &str| {
        let root = roots.get(name).and_then(|root| u32::try_from(*root).ok());
        root.ok_or_else(|| format!("it has no table `{name}`: it is no bag of ROS 2"))
    };
    let mut topics = HashMap::new();
    walk(file, index, root("topics")?, &mut |index, row, _, _| {
        let columns = columns(row.local)?;
        let column = |at: usize| columns.get(at).copied().ok_or("a topic without a name");
        let (name, type_name) = (text(row.local, column(1)?)?, text(row.local, column(2)?)?);
        let serialization = Serialization::from_name(text(row.local, column(3)?)?);
        topics.insert(row.number as i64, index.topic(name, type_name, serialization));
        Ok(())
    });
    walk(file, index, root("messages")?, &mut |index, row, page, cell| {
        let columns = columns(row.local)?;
        let [_, topic, time, data, ..] = columns[..] else { return Err(String::from("a message without data")) };
        let topic = *topics.get(&integer(row.local, topic)?).ok_or("a message is of no topic")?;
        let log_ns = integer(row.local, time)?.max(0) as u64;
        if let Err(reason) = check_further_pages(file, pages, row) {
            let at = u64::from(page - 1) * pages.size as u64;
            index.lose(file, at, row.length.min(file.length.saturating_sub(at)), format!("a message: {reason}"));
            return Ok(());
        }
        index.add_message(topic, log_ns, Place::Row { page, cell }, row.local.get(data.at..).unwrap_or_default());
        Ok(())
    });
    Ok(())
}

/// Receives a row, the number of its page, and the offset of its cell in the page.
type RowVisitor<'a> = dyn FnMut(&mut Index, &Row<'_>, u32, u16) -> Result<(), String> + 'a;

/// Calls `visit` with every row of the table whose tree begins on page `root`. Pages that are damaged are noted and
/// left out.
fn walk(file: &Store, index: &mut Index, root: u32, visit: &mut RowVisitor<'_>) {
    let Some(pages) = file.pages else { return };
    let mut seen = HashSet::new();
    let mut waiting = vec![root];
    while let Some(number) = waiting.pop() {
        let found = match seen.insert(number) {
            true => walk_page(file, index, pages, number, &mut waiting, visit),
            false => Err(String::from("a page is twice in a table")),
        };
        if let Err(reason) = found {
            let at = u64::from(number).saturating_sub(1) * pages.size as u64;
            index.lose(file, at.min(file.length), (pages.size as u64).min(file.length.saturating_sub(at)), reason);
        }
    }
}

fn walk_page(
    file: &Store,
    index: &mut Index,
    pages: Pages,
    number: u32,
    waiting: &mut Vec<u32>,
    visit: &mut RowVisitor<'_>,
) -> Result<(), String> {
    let page = read_page(file, pages, number)?;
    let head = if number == 1 { FILE_HEAD } else { 0 };
    let cells = |from: usize| {
        let count = u16_at(&page, head + 3)?;
        (0..usize::from(count)).map(|k| u16_at(&page, from + 2 * k)).collect::<Result<Vec<_>, _>>()
    };
    match page.get(head) {
        Some(5) => {
            waiting.push(u32_at(&page, head + 8)?);
            let children: Result<Vec<u32>, String> =
                cells(head + 12)?.into_iter().map(|cell| u32_at(&page, usize::from(cell))).collect();
            waiting.extend(children?.into_iter().rev());
            Ok(())
        }
        Some(13) => {
            for cell in cells(head + 8)? {
                let row = parse_cell(&page, pages, usize::from(cell))?;
                visit(index, &row, number, cell)?;
            }
            Ok(())
        }
        _ => Err(format!("page {number} is of no table")),
    }
}

/// Checks that the pages on which a row goes on are there.
fn check_further_pages(file: &Store, pages: Pages, row: &Row<'_>) -> Result<(), String> {
    let (mut next, mut left) = (row.next, row.length - row.local.len() as u64);
    while left > 0 {
        let at = u64::from(next).saturating_sub(1) * pages.size as u64;
        let mut link = [0; 4];
        if next == 0 || at + pages.size as u64 > file.length || !matches!(file.read_some(at, &mut link), Ok(4)) {
            return Err(format!("page {next}, on which it goes on, is not there"));
        }
        left = left.saturating_sub(pages.usable as u64 - 4);
        next = u32::from_be_bytes(link);
    }
    Ok(())
}

fn read_page(file: &Store, pages: Pages, number: u32) -> Result<Vec<u8>, String> {
    let at = u64::from(number.checked_sub(1).ok_or("a page has the number 0")?) * pages.size as u64;
    let page = file.read_range(at, pages.size as u64).map_err(|error| error.to_string())?;
    if page.len() == pages.size { Ok(page) } else { Err(format!("page {number} is beyond the end of the file")) }
}

fn u16_at(page: &[u8], at: usize) -> Result<u16, String> {
    let bytes = page.get(at..).and_then(<[u8]>::first_chunk).ok_or(CUT)?;
    Ok(u16::from_be_bytes(*bytes))
}

fn u32_at(page: &[u8], at: usize) -> Result<u32, String> {
    let bytes = page.get(at..).and_then(<[u8]>::first_chunk).ok_or(CUT)?;
    Ok(u32::from_be_bytes(*bytes))
}

const CUT: &str = "a page ends within what it holds";

/// Returns the number at `at`, 7 bits a byte, and moves `at` behind it.
fn varint(bytes: &[u8], at: &mut usize) -> Result<u64, String> {
    let mut value = 0_u64;
    for k in 0..9 {
        let byte = *bytes.get(*at).ok_or(CUT)?;
        *at += 1;
        if k == 8 {
            return Ok(value << 8 | u64::from(byte));
        }
        value = value << 7 | u64::from(byte & 0x7f);
        if byte < 0x80 {
            break;
        }
    }
    Ok(value)
}

fn parse_cell(page: &[u8], Pages { usable, .. }: Pages, cell: usize) -> Result<Row<'_>, String> {
    let mut at = cell;
    let (length, number) = (varint(page, &mut at)?, varint(page, &mut at)?);
    let most = usable - 35;
    let local = if length <= most as u64 {
        length as usize
    } else {
        let least = (usable - 12) * 32 / 255 - 23;
        let filled = least + ((length - least as u64) % (usable as u64 - 4)) as usize;
        if filled <= most { filled } else { least }
    };
    let bytes = page.get(at..at + local).ok_or(CUT)?;
    let next = if local as u64 == length { 0 } else { u32_at(page, at + local)? };
    Ok(Row { number, length, local: bytes, next })
}

/// Returns the columns of a row.
fn columns(row: &[u8]) -> Result<Vec<Column>, String> {
    let mut at = 0;
    let end = usize::try_from(varint(row, &mut at)?).unwrap_or(usize::MAX);
    let mut found: Vec<Column> = Vec::new();
    let mut from = end;
    while at < end {
        let code = varint(row, &mut at)?;
        let length = match code {
            0 | 8 | 9 => 0,
            1..=4 => code,
            5 => 6,
            6 | 7 => 8,
            10 | 11 => return Err(String::from("a column is of a kind that SQLite keeps for later")),
            _ => (code - 12) / 2,
        };
        found.push(Column { code, at: from, length });
        from = from.saturating_add(usize::try_from(length).unwrap_or(usize::MAX));
    }
    Ok(found)
}

fn integer(row: &[u8], Column { code, at, length }: Column) -> Result<i64, String> {
    match code {
        8 | 9 => Ok(code as i64 - 8),
        1..=6 => {
            let bytes = row.get(at..).and_then(|rest| rest.get(..length as usize)).ok_or(CUT)?;
            let first = if bytes[0] >= 0x80 { -1 } else { 0 };
            Ok(bytes.iter().fold(first, |value: i64, byte| value << 8 | i64::from(*byte)))
        }
        _ => Err(String::from("a column is no whole number")),
    }
}

fn text(row: &[u8], Column { code, at, length }: Column) -> Result<&str, String> {
    let bytes = row.get(at..).and_then(|rest| rest.get(..usize::try_from(length).unwrap_or(usize::MAX))).ok_or(CUT)?;
    match str::from_utf8(bytes) {
        Ok(text) if code >= 13 && code % 2 == 1 => Ok(text),
        _ => Err(String::from("a column is no text")),
    }
}

/// Reads what was sent, of the row of a message.
pub fn read_message(file: &Store, page: u32, cell: u16) -> Result<Vec<u8>, String> {
    let pages = file.pages.ok_or("it is in no database")?;
    let page = read_page(file, pages, page)?;
    let row = parse_cell(&page, pages, usize::from(cell))?;
    let data = *columns(row.local)?.get(3).ok_or("a message without data")?;
    if row.length > MAX_CHUNK_BYTES.min(file.length) {
        return Err(format!("its row claims {} bytes", row.length));
    }
    let mut bytes = row.local.to_vec();
    let mut next = row.next;
    // Each further page has at least a byte, so that this ends.
    while (bytes.len() as u64) < row.length {
        let page = read_page(file, pages, next)?;
        let left = (row.length - bytes.len() as u64).min(pages.usable as u64 - 4) as usize;
        bytes.extend_from_slice(&page[4..4 + left]);
        next = u32_at(&page, 0)?;
    }
    let end = data.at.saturating_add(usize::try_from(data.length).unwrap_or(usize::MAX));
    bytes.truncate(end);
    if bytes.len() < end || data.at > end { Err(CUT.to_owned()) } else { Ok(bytes.split_off(data.at)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_of_columns_that_sqlite_keeps_for_later_are_refused() {
        for code in [10, 11] {
            assert!(columns(&[2, code]).is_err_and(|problem| problem.contains("for later")), "{code}");
        }
        assert!(columns(&[2, 12]).is_ok_and(|columns| columns.len() == 1 && columns[0].length == 0));
    }
}
