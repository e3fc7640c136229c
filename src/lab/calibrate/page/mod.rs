//! The page beside a calibrated sensor's file: how far its images are from the real ones, and where.
//!
//! One HTML file with its pictures and plots in it, without scripts; the same content gives the same bytes.

mod plots;

use image::RgbImage;
use image::imageops::{self, FilterType};
use maud::{Markup, html};

use crate::compare::score::{Score, Scores};
use crate::page;
use crate::presses::Circle;
use crate::preview::difference;
use gelsim_files::png::encode_rgb;

/// Width of the pictures of a press, px, at most.
const PANEL_PX: u32 = 320;
/// What a difference is multiplied by.
const GAIN: i32 = 4;

/// What the page shows.
#[derive(Clone, Debug)]
pub struct Page<'a> {
    /// The sensor's name.
    pub sensor: &'a str,
    /// What the fit is worth, in a sentence, and whether that is nothing.
    pub verdict: (String, bool),
    /// The table at its top: what, and its figure with unit.
    pub summary: &'a [(String, String)],
    /// Sentences for people to heed; may be empty.
    pub warnings: &'a [String],
    /// In the order of the table that they come from; may be empty. Images of one press are of one size.
    pub presses: &'a [PressPanel],
    /// Pictures of the fitted colour over normal directions, each with what it shows.
    pub normals: &'a [(String, RgbImage)],
}

/// A press and what the fit makes of it.
#[derive(Clone, Debug)]
pub struct PressPanel {
    /// Its image's name.
    pub file: String,
    /// The image.
    pub real: RgbImage,
    /// The simulated one, of a fit that did not see this press.
    pub simulated: RgbImage,
    /// Where the ball touched.
    pub circle: Option<Circle>,
    /// How far the two images are apart.
    pub scores: Scores,
    /// Why the press may be unusable; empty if nothing speaks against it.
    pub outlier_reasons: Vec<String>,
}

impl PressPanel {
    /// By which presses are ranked: mean absolute error around the contact, or of the whole image without one.
    fn error(&self) -> f64 {
        self.scores.contact.unwrap_or(self.scores.full_image).mae
    }
}

impl Page<'_> {
    /// The complete file.
    pub fn html(&self) -> String {
        let mut ranked: Vec<&PressPanel> = self.presses.iter().collect();
        ranked.sort_by(|a, b| a.error().total_cmp(&b.error()));
        let (verdict, is_hopeless) = &self.verdict;
        let body = html! {
            p.bad[*is_hopeless] { b { (sentence(verdict)) } }
            (page::facts(self.summary))
            (page::warnings(self.warnings))
            (self.plots(&ranked))
            (self.normals())
            (presses(&ranked))
        };
        page::document(&format!("Calibration of {}", self.sensor), &body)
    }

    fn plots(&self, ranked: &[&PressPanel]) -> Markup {
        let Some(typical) = ranked.get(ranked.len() / 2) else { return Markup::default() };
        html! {
            h2 { "Errors" }
            p {
                "Mean absolute error in grey levels (0 to 255) around the contact; each press was simulated by a fit that did not "
                "see it. Red: presses that may be unusable."
            }
            @for plot in [plots::errors(self.presses), plots::by_radius(self.presses), plots::places(self.presses)] {
                (page::figure(plot, ""))
            }
            h2 { "Colour through a typical press" }
            p {
                (typical.file) ", the press of median error: real (solid) and simulated (dashed) through the circle's centre; grey "
                "lines are its rim."
            }
            @for plot in plots::profiles(typical) { (page::figure(plot, "")) }
        }
    }

    fn normals(&self) -> Markup {
        html! {
            @if !self.normals.is_empty() {
                h2 { "Fitted colour of normal directions" }
                p { "The middle of a disc is the flat pad, its sides are slopes to these sides." }
                @for (what, image) in self.normals { (page::figure(html! { img src=(uri(image)) alt=""; }, what)) }
            }
        }
    }
}

/// With a capital letter and a full stop.
fn sentence(text: &str) -> String {
    let mut characters = text.chars();
    let first = characters.next().map(|first| first.to_uppercase().to_string());
    format!("{}{}.", first.unwrap_or_default(), characters.as_str())
}

/// All presses, from the best to the worst.
fn presses(ranked: &[&PressPanel]) -> Markup {
    html! {
        @if !ranked.is_empty() {
            h2 { "Presses, best first" }
            p { "Real, simulated, and " (GAIN) " times their difference around grey." }
        }
        @for shown in ranked {
            section {
                @for image in [&shown.real, &shown.simulated, &difference(&shown.real, &shown.simulated, GAIN)] {
                    (panel(image, shown.circle.as_ref())) " "
                }
                p {
                    b { (shown.file) } " " (scores(&shown.scores))
                    @for reason in &shown.outlier_reasons { br; span.bad { (reason) } }
                }
            }
        }
    }
}

fn scores(scores: &Scores) -> String {
    let text = |name: &str, score: &Score| {
        let psnr = score.psnr_db.map_or(String::from("no difference"), |psnr| format!("PSNR {psnr:.1} dB"));
        format!("{name}: MAE {:.2}, {psnr}, SSIM {:.3}", score.mae, score.ssim)
    };
    let contact = scores.contact.map(|contact| text("contact", &contact) + "; ").unwrap_or_default();
    contact + &text("whole image", &scores.full_image)
}

/// An image with the circle over it, as SVG, so that both are sharp at any size.
fn panel(image: &RgbImage, circle: Option<&Circle>) -> Markup {
    let (width, height) = image.dimensions();
    let shown = width.clamp(1, PANEL_PX);
    let tall = (u64::from(height) * u64::from(shown) / u64::from(width.max(1))).max(1) as u32;
    let resized = (shown < width).then(|| imageops::resize(image, shown, tall, FilterType::Triangle));
    html! {
        svg width=(shown) height=(tall) viewBox={ "0 0 " (width) " " (height) } {
            image width=(width) height=(height) href=(uri(resized.as_ref().unwrap_or(image))) {}
            @if let Some(Circle { centre_px: [x, y], radius_px }) = circle {
                circle cx=(format!("{:.2}", x + 0.5)) cy=(format!("{:.2}", y + 0.5)) r=(format!("{radius_px:.2}"))
                    fill="none" stroke="#fff" stroke-width="1" vector-effect="non-scaling-stroke" {}
            }
        }
    }
}

/// An image as the address of itself.
fn uri(image: &RgbImage) -> String {
    page::uri(&encode_rgb(image.width() as usize, image.height() as usize, image.as_raw()))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::compare::score::score;

    fn shown(number: u32, circle: Option<Circle>, outlier_reasons: Vec<String>) -> PressPanel {
        let real = RgbImage::from_fn(64, 48, |x, y| Rgb([(4 * x) as u8, (5 * y) as u8, 100]));
        let simulated = RgbImage::from_fn(64, 48, |x, y| Rgb([(4 * x) as u8, (5 * y) as u8, 100 + number as u8]));
        let scores = score(&real, &simulated, circle.as_ref(), 1.3);
        PressPanel { file: format!("images/{number:04}.png"), real, simulated, circle, scores, outlier_reasons }
    }

    fn page_of(presses: &[PressPanel]) -> String {
        let summary = [(String::from("thickness"), String::from("< 2 mm & more"))];
        let normals = [(String::from("middle"), RgbImage::from_pixel(9, 9, Rgb([9, 8, 7])))];
        let warnings = [String::from("\"0003.png\" <looks> odd")];
        let verdict = (String::from("the fit explains 81 % & more"), false);
        Page { sensor: "my <sensor>", verdict, summary: &summary, warnings: &warnings, presses, normals: &normals }
            .html()
    }

    #[test]
    fn the_page_is_whole_and_needs_nothing_else() {
        let circle = |x: f64| Some(Circle { centre_px: [x, 20.0], radius_px: 8.0 });
        let presses = [
            shown(9, circle(20.0), vec![]),
            shown(2, circle(60.0), vec![String::from("a & b")]),
            shown(5, None, vec![]),
        ];
        let html = page_of(&presses);
        assert_eq!(html, page_of(&presses));
        let places = ["0002.png</b>", "0005.png</b>", "0009.png</b>"].map(|name| html.find(name).expect("a press"));
        assert!(places.is_sorted(), "from the best to the worst");
        for text in ["my &lt;sensor&gt;", "&lt; 2 mm &amp; more", "&quot;0003.png&quot; &lt;looks&gt; odd", "a &amp; b"]
        {
            assert!(html.contains(text), "{text}");
        }
        assert_eq!(html.matches("data:image/png;base64,").count(), 3 * 3 + 1);
        assert!(!html.contains("<script") && !html.contains("src=\"http") && !html.contains("NaN"));
    }

    #[test]
    fn its_plots_and_panels_are_well_formed_whatever_the_presses() {
        let odd = Circle { centre_px: [-1e9, 1e300], radius_px: 1e200 };
        let one = |x: f64, y: f64| Some(Circle { centre_px: [x, y], radius_px: 1.0 });
        let all = [shown(0, None, vec![]), shown(3, Some(odd), vec![]), shown(4, one(0.0, 47.0), vec![])];
        for presses in [&all[..0], &all[..1], &all[1..2], &all] {
            let html = page_of(presses);
            let body = html.split_once("</title>").expect("a head").1;
            let mut rest = body;
            while let Some((_, after)) = rest.split_once("<svg") {
                let (inner, after) = after.split_once("</svg>").expect("an end");
                let parsed = roxmltree::Document::parse(&format!("<svg{inner}</svg>")).map(|_| ());
                assert!(parsed.is_ok(), "{parsed:?}: {inner}");
                rest = after;
            }
            assert!(!html.contains("NaN") && !html.contains("inf\"") && !html.contains("inf,"));
        }
    }

    #[test]
    fn large_images_are_shown_smaller_and_differences_around_grey() {
        let image = RgbImage::from_pixel(1000, 500, Rgb([10, 20, 250]));
        assert!(panel(&image, None).0.starts_with("<svg width=\"320\" height=\"160\" viewBox=\"0 0 1000 500\">"));
        let other = RgbImage::from_pixel(1000, 500, Rgb([11, 10, 0]));
        assert_eq!(difference(&image, &other, GAIN).get_pixel(3, 4).0, [132, 88, 0]);
    }
}
