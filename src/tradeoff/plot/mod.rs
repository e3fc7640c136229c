//! The plot from which a rung is chosen: error against time, logarithmic on both axes, as SVG and PNG.
//!
//! A thin line for each object, a thick one for all samples together, whose points carry the rungs' names and
//! numbers. What is said of the reference stands at the lower edge, because error 0 is on no logarithmic axis.

mod axis;
mod drawing;
pub(crate) mod ink;
mod placement;

/// What the plot shows. Times and errors that have no place on a logarithmic axis are left out, as said where they
/// are given.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plot {
    /// Over the plot: the job's name.
    pub title: String,
    /// What the error is, without its unit.
    pub error_name: String,
    /// One line each.
    pub objects: Vec<Object>,
    /// The rungs over all samples, in the order in which they are joined.
    pub all: Vec<Rung>,
    /// Error of the reference against a grid twice as fine, um, if it is known.
    pub grid_error_um: Option<f64>,
    /// CPU time of the reference, ms per sample. A rung of the same time and error 0 is taken for the reference.
    pub reference_ms: f64,
}

/// An object's rungs. Those without a positive time and error are left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// Its name.
    pub name: String,
    /// In the order in which they are joined.
    pub rungs: Vec<Rung>,
}

/// What a rung costs and how far it is from the reference. Of all samples, one with error 0 is shown at the lower
/// edge, and one without place is named below the plot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rung {
    /// Its name.
    pub name: String,
    /// CPU time, ms per sample.
    pub ms: f64,
    /// Error, um.
    pub error_um: f64,
    /// True if no other rung is as cheap and as exact; not used for objects.
    pub pareto: bool,
}

impl Plot {
    /// The plot as SVG; numbers of points show under the pointer.
    pub fn svg(&self) -> String {
        drawing::draw(self).svg()
    }

    /// The plot as PNG file of 2240 x 1500 pixels.
    pub fn png(&self) -> Vec<u8> {
        drawing::draw(self).png()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn rung(name: &str, ms: f64, error_um: f64, pareto: bool) -> Rung {
        Rung { name: name.to_owned(), ms, error_um, pareto }
    }

    fn example(objects: &[&str]) -> Plot {
        let all = vec![
            rung("paper", 2.5, 50.0, false),
            rung("draft", 1.5, 4.7, true),
            rung("standard", 4.0, 1.9, true),
            rung("high", 15.0, 0.04, true),
            rung("reference", 60.0, 0.0, true),
        ];
        // A spread of about 3 around all samples, without rule but the same every time.
        let spread =
            |i: usize, j: usize, reach: f64| reach.powf(((i * 37 + j * 11 + 5) * 29 % 100) as f64 / 50.0 - 1.0);
        let objects = objects.iter().enumerate().map(|(i, name)| Object {
            name: (*name).to_owned(),
            rungs: all
                .iter()
                .enumerate()
                .map(|(j, r)| rung(&r.name, r.ms * spread(i, j, 1.3), r.error_um * spread(j, i, 3.0), false))
                .collect(),
        });
        Plot {
            title: "tradeoff_all_objects".to_owned(),
            error_name: "height error, RMS over the view".to_owned(),
            objects: objects.collect(),
            all: all.clone(),
            grid_error_um: Some(1.2),
            reference_ms: 60.0,
        }
    }

    const NAMES: [&str; 8] = ["sphere", "torus", "dots", "hexagon_nut", "coin", "gear", "letter", "rope"];

    fn texts(svg: &str) -> Vec<String> {
        let document = roxmltree::Document::parse(svg).expect("the SVG is XML");
        let texts = document.descendants().filter(|node| node.has_tag_name("text"));
        texts
            .map(|node| node.descendants().filter_map(|inner| inner.text().filter(|_| inner.is_text())).collect())
            .collect()
    }

    fn assert_drawn(plot: &Plot) {
        texts(&plot.svg());
        let png = image::load_from_memory(&plot.png()).expect("the PNG can be read").to_rgb8();
        assert_eq!(png.dimensions(), (2240, 1500));
    }

    #[test]
    fn everything_needed_to_choose_a_rung_is_written_on_the_plot() {
        let mut plot = example(&NAMES);
        plot.title = "5 $ < 6 $ & \"more\"\u{1}".to_owned();
        let svg = plot.svg();
        let found = texts(&svg);
        let mut wanted = vec![
            "paper",
            "draft",
            "standard",
            "high",
            "reference",
            "1.5 ms, 4.7 \u{b5}m",
            "60 ms, error 0 by definition;",
        ];
        wanted.extend([
            "against a grid twice as fine: 1.2 \u{b5}m",
            "5 $ < 6 $ & \"more\" ",
            "CPU time per sample (ms)",
        ]);
        wanted.extend(["height error, RMS over the view (\u{b5}m)", drawing::CAPTION]);
        wanted.extend(NAMES);
        for wanted in wanted {
            assert_eq!(found.iter().filter(|text| text.trim() == wanted.trim()).count(), 1, "{wanted} in {found:?}");
        }
        assert_drawn(&plot);
    }

    #[test]
    fn the_png_shows_text_and_lines() {
        let png = image::load_from_memory(&example(&NAMES).png()).unwrap().to_rgb8();
        let dark = |x0: u32, y0: u32, x1: u32, y1: u32| {
            let pixels = (y0..y1).flat_map(|y| (x0..x1).map(move |x| (x, y)));
            pixels.filter(|(x, y)| png.get_pixel(*x, *y).0.iter().all(|level| *level < 110)).count()
        };
        // Title, legend, caption; and the white margin over the title.
        assert!(dark(48, 40, 700, 90) > 1500);
        assert!(dark(1850, 140, 2200, 700) > 1500);
        assert!(dark(48, 1400, 1800, 1460) > 1500);
        assert_eq!(dark(0, 0, 2240, 30), 0);
    }

    #[test]
    fn rungs_that_cannot_be_shown_are_named() {
        let mut plot = example(&NAMES[..1]);
        plot.all[0].error_um = f64::NAN;
        plot.all[2].ms = 0.0;
        plot.all[3].error_um = 0.0;
        let found = texts(&plot.svg());
        assert!(found.iter().any(|text| text.contains("Not shown") && text.contains("paper, standard")), "{found:?}");
        assert!(found.iter().any(|text| text == "15 ms, error 0"), "{found:?}");
        assert_drawn(&Plot::default());
    }

    #[test]
    fn a_plot_is_the_same_every_time() {
        let plot = example(&NAMES);
        assert_eq!((plot.svg(), plot.png()), (plot.svg(), plot.png()));
    }

    fn numbers() -> impl Strategy<Value = f64> {
        let odd = [0.0, -0.0, -1.0, 1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324, 1e-300, f64::MAX];
        prop_oneof![prop::sample::select(odd.to_vec()), 1e-3f64..1e3]
    }

    fn rungs() -> impl Strategy<Value = Vec<Rung>> {
        let rung = ("[a-c<&$\\u{0}\u{b5}]{0,8}", numbers(), numbers(), any::<bool>());
        let rung = rung.prop_map(|(name, ms, error_um, pareto)| Rung { name, ms, error_um, pareto });
        prop::collection::vec(rung, 0..6)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn no_numbers_are_too_odd_to_be_drawn(
            title in any::<String>(),
            objects in prop::collection::vec((any::<String>(), rungs()), 0..4),
            all in rungs(),
            grid_error_um in prop::option::of(numbers()),
            reference_ms in numbers(),
        ) {
            let error_name = title.clone();
            let objects = objects.into_iter().map(|(name, rungs)| Object { name, rungs }).collect();
            let plot = Plot { title, error_name, objects, all, grid_error_um, reference_ms };
            let svg = plot.svg();
            texts(&svg);
            prop_assert!(!svg.contains("NaN") && !svg.contains("inf"), "{}", svg);
            plot.png();
        }
    }
}
