//! HTML pages for people: one file that contains its pictures and plots, without scripts. The same content gives the
//! same bytes.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::RgbImage;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

use canvas::Colour;
use gelsim_files::spelling::escape_hidden_chars;

pub mod bars;
pub mod canvas;
pub mod letters;
pub mod plot;

/// Renders a complete HTML page.
pub fn render_document(title: &str, body: &Markup) -> String {
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
    make_legible(&page.0) + "\n"
}

/// Replaces characters that XML cannot hold by spaces, and shows those that are not seen but turn or hide text.
fn make_legible(text: &str) -> String {
    let odd = |c: char| c.is_control() && c != '\n' || matches!(c, '\u{fffe}' | '\u{ffff}');
    escape_hidden_chars(&text.replace(odd, " ")).into_owned()
}

/// Renders the main figures as cards in a row.
pub fn render_cards(cards: &[(String, &str)]) -> Markup {
    html! { div.cards { @for (number, what) in cards { div { b { (number) } (what) } } } }
}

/// Renders a table of names and figures.
pub fn render_facts(rows: &[(impl Render, impl Render)]) -> Markup {
    html! { table { @for (what, figure) in rows { tr { th { (what) } td { (figure) } } } } }
}

/// Renders a table with a head. It scrolls by itself if the window is too narrow for it.
pub fn render_table<C: Render>(
    head: impl IntoIterator<Item = impl Render>,
    rows: impl IntoIterator<Item = Vec<C>>,
) -> Markup {
    html! {
        div.wide {
            table.columns {
                tr { @for name in head { th { (name) } } }
                @for row in rows { tr { @for cell in row { td { (cell) } } } }
            }
        }
    }
}

/// Renders words in a cell of a table; they may take several lines.
pub fn render_text_cell(text: impl Render) -> Markup {
    html! { span.text { (text) } }
}

/// Renders warnings as a list under a heading; nothing if there are none.
pub fn render_warnings(texts: &[String]) -> Markup {
    html! {
        @if !texts.is_empty() {
            h2 { "Warnings" }
            ul.bad { @for text in texts { li { (text) } } }
        }
    }
}

/// Renders a picture or plot with a caption below it.
pub fn render_figure(content: impl Render, caption: impl Render) -> Markup {
    // The space allows lines to break between figures that stand in a row.
    html! { figure { (content) figcaption { (caption) } } " " }
}

/// Renders figures of at most 330 px in as many columns as the window has room for.
pub fn render_figures(figures: impl Render) -> Markup {
    html! { div.figures { (figures) } }
}

/// Renders a PNG file of this width and height, px, as part of the page.
pub fn render_image(png: &[u8], (width, height): (u32, u32), caption: &str) -> Markup {
    html! { img src=(png_data_uri(png)) width=(width) height=(height) alt=(caption); }
}

/// Width of a thumbnail, px.
const THUMBNAIL_PX: u32 = 150;

/// Scales an image down to the width of a thumbnail; a smaller one stays as it is.
pub fn make_thumbnail(image: &RgbImage) -> RgbImage {
    let (width, height) = image.dimensions();
    if width <= THUMBNAIL_PX {
        return image.clone();
    }
    image::imageops::thumbnail(image, THUMBNAIL_PX, (height * THUMBNAIL_PX / width).max(1))
}

/// Renders a small figure; a click shows the large one over the whole window, another click closes it. `name` must be
/// unique in the page.
pub fn render_lightbox(name: &str, small: impl Render, large: impl Render) -> Markup {
    html! {
        a id={ "of-" (name) } href={ "#" (name) } { (small) }
        a.large id=(name) href={ "#of-" (name) } { (large) }
    }
}

/// Renders a name with a square of its colour.
pub fn render_legend_entry((name, [r, g, b]): (&str, Colour)) -> Markup {
    html! { span.keyed { i style={ "background: rgb(" (r) ", " (g) ", " (b) ")" } {} (name) } }
}

/// Renders names with squares of their colours.
pub fn render_legend<'a>(keys: impl IntoIterator<Item = &'a (&'a str, Colour)>) -> Markup {
    html! { @for name in keys { (render_legend_entry(*name)) " " } }
}

/// Returns a `data:` address that contains a PNG file.
pub fn png_data_uri(png: &[u8]) -> String {
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
            (render_facts(&[(&odd, &odd)]))
            (render_table(["a", "b"], [vec![odd.as_str(), "1"]]))
            (render_warnings(std::slice::from_ref(&odd)))
            (render_figure(html! { svg {} }, &odd))
        };
        // What HTML leaves open, XML closes.
        let page =
            render_document(&odd, &body).replace("\"utf-8\">", "\"utf-8\"/>").replace("scale=1\">", "scale=1\"/>");
        let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
        let parsed = roxmltree::Document::parse_with_options(&page, options).expect("well-formed");
        let texts = parsed.descendants().filter(|node| node.is_text()).filter_map(|node| node.text());
        // Title and heading, two in the first table, one each in the rest.
        assert_eq!(texts.filter(|text| text.contains("<b> & \"quotes\" ]]> ")).count(), 7);
        assert!(render_warnings(&[]).0.is_empty());
    }
}
