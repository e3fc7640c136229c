//! HTML pages for people: one file with its pictures and plots in it, without scripts, well-formed as XML, so that
//! tests can read it. The same content gives the same bytes.

use std::fmt::Write;

use gelsim_files::spelling::{is_hidden, visible};

pub mod bars;
pub mod ink;
pub mod letters;
pub mod plot;

/// A whole page; `title` is plain text, `body` is HTML.
pub fn document(title: &str, body: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n<title>{title}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n<h1>{title}</h1>\n{body}</body>\n</html>\n"
    )
}

/// A table of names and figures, both plain text.
pub fn facts(rows: &[(String, String)]) -> String {
    let row = |(what, figure): &(String, String)| {
        format!("<tr><th>{}</th><td>{}</td></tr>\n", escaped(what), escaped(figure))
    };
    format!("<table>\n{}</table>\n", rows.iter().map(row).collect::<String>())
}

/// A table under a head; the cells are HTML. It scrolls by itself where the window is too narrow for it.
pub fn table(head: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let mut html = String::from("<div class=\"wide\"><table class=\"columns\">\n<tr>");
    for name in head {
        let _ = write!(html, "<th>{name}</th>");
    }
    html += "</tr>\n";
    for row in rows {
        let cells: String = row.iter().map(|cell| format!("<td>{cell}</td>")).collect();
        let _ = writeln!(html, "<tr>{cells}</tr>");
    }
    html + "</table></div>\n"
}

/// A list of things to heed, plain text, under its heading; nothing if there are none.
pub fn warnings(texts: &[String]) -> String {
    let item = |text: &String| format!("<li>{}</li>\n", escaped(text));
    match texts {
        [] => String::new(),
        all => format!("<h2>Warnings</h2>\n<ul class=\"bad\">\n{}</ul>\n", all.iter().map(item).collect::<String>()),
    }
}

/// A picture or plot with HTML below it.
pub fn figure(content: &str, caption: &str) -> String {
    match caption {
        "" => format!("<figure>\n{content}\n</figure>\n"),
        _ => format!("<figure>\n{content}\n<figcaption>{caption}</figcaption></figure>\n"),
    }
}

/// Figures of at most 330 px in columns, as many as the window has room for.
pub fn figures(figures: &str) -> String {
    format!("<div class=\"figures\">\n{figures}</div>\n")
}

/// A PNG file of this width and height, px; `caption` is HTML.
pub fn image(png: &[u8], (width, height): (u32, u32), caption: &str) -> String {
    format!("<img src=\"{}\" width=\"{width}\" height=\"{height}\" alt=\"{caption}\"/>", uri(png))
}

/// HTML that a click opens over the whole window, and another one closes; `name` is the page's only one of its kind.
pub fn opens(name: &str, small: &str, large: &str) -> String {
    format!(
        "<a id=\"of-{name}\" href=\"#{name}\">{small}</a>\n<a class=\"large\" id=\"{name}\" href=\"#of-{name}\">{large}</a>"
    )
}

/// A PNG file as the address of itself.
pub fn uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", base64(png))
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let bits = (0..3).fold(0, |bits, k| bits << 8 | u32::from(three.get(k).copied().unwrap_or(0)));
        for k in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * k)) as usize & 63];
            text.push(if k <= three.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

/// Text that HTML takes for nothing else; what XML cannot hold becomes a space.
pub fn escaped(text: &str) -> String {
    escaped_lines(&text.replace('\n', " "))
}

/// The same with its lines kept.
pub fn escaped_lines(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '&' => out += "&amp;",
            '"' => out += "&quot;",
            '\n' => out.push('\n'),
            c if is_hidden(c) && !c.is_control() => out += &visible(c.encode_utf8(&mut [0; 4])),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

const STYLE: &str = "\
body { margin: 2em auto; max-width: 1040px; padding: 0 1em; font: 15px/1.5 sans-serif; color: #222; background: #fff }
h1 { font-size: 24px; overflow-wrap: anywhere } h2 { font-size: 18px; margin: 2em 0 0.5em } h3 { font-size: 15px }
table { border-collapse: collapse } th, td { padding: 3px 16px 3px 0; border-bottom: 1px solid #ddd; text-align: left }
th { font-weight: normal; color: #555; vertical-align: top } td { overflow-wrap: anywhere }
.wide { overflow-x: auto; margin: 0 0 1em }
.columns { font-variant-numeric: tabular-nums } .columns td + td, .columns th + th { text-align: right }
.columns td { white-space: nowrap } .columns .text { display: block; min-width: 18em; text-align: left; white-space: normal }
figure { display: inline-block; margin: 0 12px 16px 0; vertical-align: top } figcaption { font-size: 13px; color: #555 }
.figures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(330px, 100%), 1fr)); gap: 16px 20px }
.figures { margin: 12px 0 } .figures figure { margin: 0 }
svg, img { max-width: 100%; height: auto } .figures img { outline: 1px solid #bbb }
.large { display: none } .large:target { display: flex; align-items: center; justify-content: center; position: fixed; inset: 0 }
.large { z-index: 1; background: rgba(0, 0, 0, 0.85) } .figures .large img { outline: none } .large img { max-height: 98vh; width: auto; max-width: 98vw; object-fit: contain }
section { margin: 0 0 20px } section p { margin: 2px 0; font-size: 13px } section svg { margin-right: 8px }
.bad { color: #a01e28 } .note { font-size: 13px; color: #555 }
.cards { display: flex; flex-wrap: wrap; gap: 10px; margin: 16px 0 }
.cards div { flex: 1 1 96px; padding: 8px 12px; border: 1px solid #ddd; border-radius: 6px; font-size: 13px; color: #555 }
.cards b { display: block; font-size: 20px; line-height: 1.3; color: #222; white-space: nowrap }
.keyed { white-space: nowrap } .keyed i { display: inline-block; width: 0.8em; height: 0.8em; margin: 0 4px 0 0; border-radius: 2px }
.share { display: inline-block; height: 0.7em; margin-left: 8px; background: #7aa6c8; vertical-align: middle }
details { margin: 0 0 1em } summary { cursor: pointer; color: #0060a0 }
pre { padding: 10px; overflow-x: auto; font-size: 12px; line-height: 1.4; background: #f6f6f6 }
@media print { body { margin: 0; max-width: none } figure, tr, .cards { break-inside: avoid } h2 { break-after: avoid } }
";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        let pairs =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg=="), ("fooba", "Zm9vYmE=")];
        for (plain, coded) in pairs {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xfe]), "+//+");
    }

    #[test]
    fn a_page_of_odd_texts_is_well_formed() {
        let odd = String::from("<b> & \"quotes\" ]]> \u{0}\u{1b}\u{fffe} \u{1f600}\nnext");
        let body = [
            facts(&[(odd.clone(), odd.clone())]),
            table(&["a", "b"], [vec![escaped(&odd), String::from("1")]]),
            warnings(std::slice::from_ref(&odd)),
            figure("<img src=\"\" alt=\"\"/>", &escaped_lines(&odd)),
        ];
        let page = document(&odd, &body.concat());
        let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
        let parsed = roxmltree::Document::parse_with_options(&page, options).expect("well-formed");
        let texts = parsed.descendants().filter(|node| node.is_text()).filter_map(|node| node.text());
        // Title and heading, two in the first table, one each in the rest.
        assert_eq!(texts.filter(|text| text.contains("<b> & \"quotes\" ]]> ")).count(), 7);
        assert!(warnings(&[]).is_empty());
    }
}
