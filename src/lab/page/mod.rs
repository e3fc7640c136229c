//! HTML pages for people: one file with its pictures and plots in it, without scripts. The same content gives the same bytes.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

use canvas::Colour;
use gelsim_files::spelling::visible;

pub mod bars;
pub mod canvas;
pub mod letters;
pub mod plot;

/// A whole page.
pub fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { h1 { (title) } (body) }
        }
    };
    legible(&page.0) + "\n"
}

/// What XML cannot hold becomes a space; characters that are not seen but turn or hide text are shown.
fn legible(text: &str) -> String {
    let odd = |c: char| c.is_control() && c != '\n' || matches!(c, '\u{fffe}' | '\u{ffff}');
    visible(&text.replace(odd, " ")).into_owned()
}

/// The figures that people ask for first.
pub fn cards(cards: &[(String, &str)]) -> Markup {
    html! { div.cards { @for (number, what) in cards { div { b { (number) } (what) } } } }
}

/// A table of names and figures.
pub fn facts(rows: &[(impl Render, impl Render)]) -> Markup {
    html! { table { @for (what, figure) in rows { tr { th { (what) } td { (figure) } } } } }
}

/// A table under a head. It scrolls by itself where the window is too narrow for it.
pub fn table<C: Render>(head: impl IntoIterator<Item = impl Render>, rows: impl IntoIterator<Item = Vec<C>>) -> Markup {
    html! {
        div.wide {
            table.columns {
                tr { @for name in head { th { (name) } } }
                @for row in rows { tr { @for cell in row { td { (cell) } } } }
            }
        }
    }
}

/// Words in a cell of a table, which may run over lines.
pub fn words(text: impl Render) -> Markup {
    html! { span.text { (text) } }
}

/// A list of things to heed under its heading; nothing if there are none.
pub fn warnings(texts: &[String]) -> Markup {
    html! {
        @if !texts.is_empty() {
            h2 { "Warnings" }
            ul.bad { @for text in texts { li { (text) } } }
        }
    }
}

/// A picture or plot with a caption below it.
pub fn figure(content: impl Render, caption: impl Render) -> Markup {
    // Figures stand in a line with a space between them.
    html! { figure { (content) figcaption { (caption) } } " " }
}

/// Figures of at most 330 px in columns, as many as the window has room for.
pub fn figures(figures: impl Render) -> Markup {
    html! { div.figures { (figures) } }
}

/// A PNG file of this width and height, px.
pub fn image(png: &[u8], (width, height): (u32, u32), caption: &str) -> Markup {
    html! { img src=(uri(png)) width=(width) height=(height) alt=(caption); }
}

/// What a click opens over the whole window, and another one closes; `name` is the page's only one of its kind.
pub fn opens(name: &str, small: impl Render, large: impl Render) -> Markup {
    html! {
        a id={ "of-" (name) } href={ "#" (name) } { (small) }
        a.large id=(name) href={ "#of-" (name) } { (large) }
    }
}

/// A name beside a square of its colour.
pub fn key((name, [r, g, b]): (&str, Colour)) -> Markup {
    html! { span.keyed { i style={ "background: rgb(" (r) ", " (g) ", " (b) ")" } {} (name) } }
}

/// Names beside squares of their colours.
pub fn keys<'a>(keys: impl IntoIterator<Item = &'a (&'a str, Colour)>) -> Markup {
    html! { @for name in keys { (key(*name)) " " } }
}

/// A PNG file as the address of itself.
pub fn uri(png: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(png))
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
    fn a_page_of_odd_texts_is_well_formed() {
        let odd = String::from("<b> & \"quotes\" ]]> \u{0}\u{1b}\u{fffe} \u{1f600}\nnext");
        let body = html! {
            (facts(&[(&odd, &odd)]))
            (table(["a", "b"], [vec![odd.as_str(), "1"]]))
            (warnings(std::slice::from_ref(&odd)))
            (figure(html! { svg {} }, &odd))
        };
        // What HTML leaves open, XML closes.
        let page = document(&odd, &body).replace("\"utf-8\">", "\"utf-8\"/>").replace("scale=1\">", "scale=1\"/>");
        let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
        let parsed = roxmltree::Document::parse_with_options(&page, options).expect("well-formed");
        let texts = parsed.descendants().filter(|node| node.is_text()).filter_map(|node| node.text());
        // Title and heading, two in the first table, one each in the rest.
        assert_eq!(texts.filter(|text| text.contains("<b> & \"quotes\" ]]> ")).count(), 7);
        assert!(warnings(&[]).0.is_empty());
    }
}
