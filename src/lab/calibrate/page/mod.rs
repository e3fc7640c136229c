//! The page beside a calibrated sensor's file: how far its images are from the real ones, and where.
//!
//! One HTML file with its pictures and plots in it, without scripts; the same content gives the same bytes.

mod plots;

use std::fmt::Write;

use image::RgbImage;
use image::imageops::{self, FilterType};

use crate::compare::score::{Score, Scores};
use crate::page::{self, escaped};
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
        let class = if *is_hopeless { " class=\"bad\"" } else { "" };
        let verdict = format!("<p{class}><b>{}</b></p>\n", escaped(&sentence(verdict)));
        let (facts, warnings) = (page::facts(self.summary), page::warnings(self.warnings));
        let parts = [verdict, facts, warnings, self.plots(&ranked), self.normals()];
        page::document(&format!("Calibration of {}", self.sensor), &(parts.concat() + &presses(&ranked)))
    }

    fn plots(&self, ranked: &[&PressPanel]) -> String {
        let Some(typical) = ranked.get(ranked.len() / 2) else { return String::new() };
        let mut html = String::from(
            "<h2>Errors</h2>\n<p>Mean absolute error in grey levels (0 to 255) around the \
            contact; each press was simulated by a fit that did not see it. Red: presses that may be unusable.</p>\n",
        );
        for plot in [plots::errors(self.presses), plots::by_radius(self.presses), plots::places(self.presses)] {
            html += &page::figure(&plot, "");
        }
        let _ = write!(
            html,
            "<h2>Colour through a typical press</h2>\n<p>{}, the press of median error: real (solid) and simulated (dashed) \
             through the circle's centre; grey lines are its rim.</p>\n",
            escaped(&typical.file)
        );
        for plot in plots::profiles(typical) {
            html += &page::figure(&plot, "");
        }
        html
    }

    fn normals(&self) -> String {
        let figure = |(what, image): &(String, RgbImage)| {
            page::figure(&format!("<img src=\"{}\" alt=\"\"/>", uri(image)), &escaped(what))
        };
        match self.normals {
            [] => String::new(),
            all => format!(
                "<h2>Fitted colour of normal directions</h2>\n<p>The middle of a disc is the flat pad, its sides are slopes \
                 to these sides.</p>\n{}",
                all.iter().map(figure).collect::<String>()
            ),
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
fn presses(ranked: &[&PressPanel]) -> String {
    let mut html = String::new();
    if !ranked.is_empty() {
        let _ = writeln!(
            html,
            "<h2>Presses, best first</h2>\n<p>Real, simulated, and {GAIN} times their difference \
            around grey.</p>"
        );
    }
    for shown in ranked {
        let difference = difference(&shown.real, &shown.simulated, GAIN);
        html += "<section>\n";
        for image in [&shown.real, &shown.simulated, &difference] {
            let _ = writeln!(html, "{}", panel(image, shown.circle.as_ref()));
        }
        let _ = write!(html, "<p><b>{}</b> {}", escaped(&shown.file), scores(&shown.scores));
        for suspicion in &shown.outlier_reasons {
            let _ = write!(html, "<br/><span class=\"bad\">{}</span>", escaped(suspicion));
        }
        html += "</p>\n</section>\n";
    }
    html
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
fn panel(image: &RgbImage, circle: Option<&Circle>) -> String {
    let (width, height) = image.dimensions();
    let shown = width.clamp(1, PANEL_PX);
    let tall = (u64::from(height) * u64::from(shown) / u64::from(width.max(1))).max(1) as u32;
    let small = match shown < width {
        true => imageops::resize(image, shown, tall, FilterType::Triangle),
        false => image.clone(),
    };
    let ring = |circle: &Circle| {
        let [x, y] = circle.centre_px.map(|at| at + 0.5);
        format!("<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{:.2}\" {RING}/>", circle.radius_px)
    };
    format!(
        "<svg width=\"{shown}\" height=\"{tall}\" viewBox=\"0 0 {width} {height}\"><image width=\"{width}\" \
         height=\"{height}\" href=\"{}\"/>{}</svg>",
        uri(&small),
        circle.map(ring).unwrap_or_default()
    )
}

/// An image as the address of itself.
fn uri(image: &RgbImage) -> String {
    page::uri(&encode_rgb(image.width() as usize, image.height() as usize, image.as_raw()))
}

/// How circles look, at any scale.
const RING: &str = "fill=\"none\" stroke=\"#fff\" stroke-width=\"1\" vector-effect=\"non-scaling-stroke\"";

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
        assert!(panel(&image, None).starts_with("<svg width=\"320\" height=\"160\" viewBox=\"0 0 1000 500\">"));
        let other = RgbImage::from_pixel(1000, 500, Rgb([11, 10, 0]));
        assert_eq!(difference(&image, &other, GAIN).get_pixel(3, 4).0, [132, 88, 0]);
    }
}
