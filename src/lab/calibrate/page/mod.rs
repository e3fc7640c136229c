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
use crate::preview::amplify_difference;
use gelsim_files::png::encode_rgb;

/// Largest width of the pictures of a press, px.
const PANEL_PX: u32 = 320;
/// Factor by which differences are amplified.
const GAIN: i32 = 4;

/// Content of the page.
#[derive(Clone, Debug)]
pub struct CalibrationPage<'a> {
    /// The sensor's name.
    pub sensor: &'a str,
    /// What the fit is worth, in a sentence; true if it is worth nothing.
    pub verdict: (String, bool),
    /// The table at the top: names, and values with units.
    pub summary: &'a [(String, String)],
    /// Warnings as sentences; may be empty.
    pub warnings: &'a [String],
    /// Presses in the order of their table; may be empty. The two images of a press are of one size.
    pub presses: &'a [PressPanel],
    /// Pictures of the fitted colour over normal directions, with captions.
    pub normals: &'a [(String, RgbImage)],
}

/// A press: the real image, and the simulated one of a fit that did not see it.
#[derive(Clone, Debug)]
pub struct PressPanel {
    /// Name of the image's file.
    pub file: String,
    /// The real image.
    pub real: RgbImage,
    /// The simulated image.
    pub simulated: RgbImage,
    /// Where the ball touched.
    pub circle: Option<Circle>,
    /// Differences between the two images.
    pub scores: Scores,
    /// Why the press may be unusable; empty if nothing speaks against it.
    pub outlier_reasons: Vec<String>,
}

impl PressPanel {
    /// Returns the error by which presses are ranked: the mean absolute error around the contact, or of the whole image
    /// without a circle.
    fn ranking_error(&self) -> f64 {
        self.scores.contact.unwrap_or(self.scores.full_image).mae
    }
}

impl CalibrationPage<'_> {
    /// Renders the complete file.
    pub fn to_html(&self) -> String {
        let mut ranked: Vec<&PressPanel> = self.presses.iter().collect();
        ranked.sort_by(|a, b| a.ranking_error().total_cmp(&b.ranking_error()));
        let (verdict, is_hopeless) = &self.verdict;
        let body = html! {
            p.bad[*is_hopeless] { b { (to_sentence(verdict)) } }
            (page::render_facts(self.summary))
            (page::render_warnings(self.warnings))
            (self.render_plots(&ranked))
            (self.render_normals())
            (render_presses(&ranked))
        };
        page::render_document(&format!("Calibration of {}", self.sensor), &body)
    }

    fn render_plots(&self, ranked: &[&PressPanel]) -> Markup {
        let Some(typical) = ranked.get(ranked.len() / 2) else { return Markup::default() };
        html! {
            h2 { "Errors" }
            p {
                "Mean absolute error in grey levels (0 to 255) around the contact; each press was simulated by a fit that did not "
                "see it. Red: presses that may be unusable."
            }
            @for plot in [plots::plot_errors(self.presses), plots::plot_error_by_radius(self.presses), plots::plot_circles(self.presses)] {
                (page::render_figure(plot, ""))
            }
            h2 { "Colour through a typical press" }
            p {
                (typical.file) ", the press of median error: real (solid) and simulated (dashed) through the circle's centre; grey "
                "lines are its rim."
            }
            @for plot in plots::plot_profiles(typical) { (page::render_figure(plot, "")) }
        }
    }

    fn render_normals(&self) -> Markup {
        html! {
            @if !self.normals.is_empty() {
                h2 { "Fitted colour of normal directions" }
                p { "The middle of a disc is the flat pad, its sides are slopes to these sides." }
                @for (what, image) in self.normals { (page::render_figure(html! { img src=(image_data_uri(image)) alt=""; }, what)) }
            }
        }
    }
}

/// Makes a sentence: adds a capital letter and a full stop.
fn to_sentence(text: &str) -> String {
    let mut characters = text.chars();
    let first = characters.next().map(|first| first.to_uppercase().to_string());
    format!("{}{}.", first.unwrap_or_default(), characters.as_str())
}

/// Renders all presses, from the best to the worst.
fn render_presses(ranked: &[&PressPanel]) -> Markup {
    html! {
        @if !ranked.is_empty() {
            h2 { "Presses, best first" }
            p { "Real, simulated, and " (GAIN) " times their difference around grey." }
        }
        @for shown in ranked {
            section {
                @for image in [&shown.real, &shown.simulated, &amplify_difference(&shown.real, &shown.simulated, GAIN)] {
                    (render_panel(image, shown.circle.as_ref())) " "
                }
                p {
                    b { (shown.file) } " " (format_scores(&shown.scores))
                    @for reason in &shown.outlier_reasons { br; span.bad { (reason) } }
                }
            }
        }
    }
}

fn format_scores(scores: &Scores) -> String {
    let text = |name: &str, score: &Score| {
        let psnr = score.psnr_db.map_or(String::from("no difference"), |psnr| format!("PSNR {psnr:.1} dB"));
        format!("{name}: MAE {:.2}, {psnr}, SSIM {:.3}", score.mae, score.ssim)
    };
    let contact = scores.contact.map(|contact| text("contact", &contact) + "; ").unwrap_or_default();
    contact + &text("whole image", &scores.full_image)
}

/// Draws an image with the circle over it, as SVG, so that the circle is sharp at any size.
fn render_panel(image: &RgbImage, circle: Option<&Circle>) -> Markup {
    let (width, height) = image.dimensions();
    let shown = width.clamp(1, PANEL_PX);
    let tall = (u64::from(height) * u64::from(shown) / u64::from(width.max(1))).max(1) as u32;
    let resized = (shown < width).then(|| imageops::resize(image, shown, tall, FilterType::Triangle));
    html! {
        svg width=(shown) height=(tall) viewBox={ "0 0 " (width) " " (height) } {
            image width=(width) height=(height) href=(image_data_uri(resized.as_ref().unwrap_or(image))) {}
            @if let Some(Circle { centre_px: [x, y], radius_px }) = circle {
                circle cx=(format!("{:.2}", x + 0.5)) cy=(format!("{:.2}", y + 0.5)) r=(format!("{radius_px:.2}"))
                    fill="none" stroke="#fff" stroke-width="1" vector-effect="non-scaling-stroke" {}
            }
        }
    }
}

/// Encodes an image as the `data:` address of a PNG file.
fn image_data_uri(image: &RgbImage) -> String {
    page::png_data_uri(&encode_rgb(image.width() as usize, image.height() as usize, image.as_raw()))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;
    use crate::compare::score::score_images;

    fn shown(number: u32, circle: Option<Circle>, outlier_reasons: Vec<String>) -> PressPanel {
        let real = RgbImage::from_fn(64, 48, |x, y| Rgb([(4 * x) as u8, (5 * y) as u8, 100]));
        let simulated = RgbImage::from_fn(64, 48, |x, y| Rgb([(4 * x) as u8, (5 * y) as u8, 100 + number as u8]));
        let scores = score_images(&real, &simulated, circle.as_ref(), 1.3);
        PressPanel { file: format!("images/{number:04}.png"), real, simulated, circle, scores, outlier_reasons }
    }

    fn page_of(presses: &[PressPanel]) -> String {
        let summary = [(String::from("thickness"), String::from("< 2 mm & more"))];
        let normals = [(String::from("middle"), RgbImage::from_pixel(9, 9, Rgb([9, 8, 7])))];
        let warnings = [String::from("\"0003.png\" <looks> odd")];
        let verdict = (String::from("the fit explains 81 % & more"), false);
        CalibrationPage {
            sensor: "my <sensor>",
            verdict,
            summary: &summary,
            warnings: &warnings,
            presses,
            normals: &normals,
        }
        .to_html()
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
        assert!(
            render_panel(&image, None).0.starts_with("<svg width=\"320\" height=\"160\" viewBox=\"0 0 1000 500\">")
        );
        let other = RgbImage::from_pixel(1000, 500, Rgb([11, 10, 0]));
        assert_eq!(amplify_difference(&image, &other, GAIN).get_pixel(3, 4).0, [132, 88, 0]);
    }
}
