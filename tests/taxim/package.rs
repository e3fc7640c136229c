//! Our pictures against those of the package `taxim`, of the same surfaces with its own calibrations.

use std::path::Path;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::simd::simd_dispatch;
use gelsim_core::optics::calibrated::taxim::{LookupScratch, TaximLookup};
use gelsim_files::npz::Npz;
use gelsim_lab::calibrate::taxim::{TaximImport, import_taxim_folder};

use super::colours::bins;

/// Where a pixel lies, as far as agreement goes.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Part {
    /// Less steep than the first bin, where our change fades out.
    Gentle,
    /// At the edge of a bin, as near as Taxim's single precision may be off.
    Edge,
    Rest,
}

/// A map of heights with a ring of pixels around the view, and the package's picture of the view in grey levels.
struct Case {
    height: Grid<f64>,
    picture: Vec<f64>,
}

impl Case {
    fn read(path: &Path) -> Self {
        let archive = Npz::read(path).expect("a case");
        let (height, picture) =
            (archive.read_array("height").expect("heights"), archive.read_array("picture").expect("a picture"));
        let [rows, columns] = height.shape[..] else { panic!("heights of shape {:?}", height.shape) };
        assert_eq!(picture.shape, [rows - 2, columns - 2, 3]);
        Self { height: Grid { width: columns, height: rows, data: height.values }, picture: picture.values }
    }

    /// Slopes of row `y` of the view, to the right and down. As in Taxim, the outermost pixels repeat their neighbour's.
    fn slopes(&self, y: usize, mm_per_px: f64) -> [Vec<f32>; 2] {
        let [width, height] = [self.height.width - 2, self.height.height - 2];
        let y = y.clamp(1, height - 2);
        let [above, here, below] = [0, 1, 2].map(|row| self.height.row(y + row));
        let slope = |from: f64, to: f64| ((to - from) * (0.5 / mm_per_px)) as f32;
        let columns = || (0..width).map(|x| x.clamp(1, width - 2));
        let right = columns().map(|x| slope(here[x], here[x + 2])).collect();
        [right, columns().map(|x| slope(above[x + 1], below[x + 1])).collect()]
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Agreement {
    pixels: usize,
    beyond: usize,
    worst: f64,
    sum: f64,
}

fn compare(sensor: &TaximImport, case: &Case) -> [(Part, Agreement); 3] {
    let [width, height] = sensor.colors.resolution_px;
    let mm_per_px = sensor.field_of_view_mm[0] / width as f64;
    let lookup = TaximLookup::new(&sensor.colors, [width, height]);
    let mut found = [Part::Gentle, Part::Edge, Part::Rest].map(|part| (part, Agreement::default()));
    let mut change = [(); 3].map(|()| vec![0.0; width]);
    let mut scratch = LookupScratch::default();
    for y in 0..height {
        let slopes = case.slopes(y, mm_per_px);
        let slopes = slopes.each_ref().map(Vec::as_slice);
        let [red, green, blue] = &mut change;
        simd_dispatch(
            #[inline(always)]
            || lookup.compute_row_change(y, 0, slopes, &mut scratch, [red, green, blue]),
        );
        for x in 0..width {
            let [steepness, direction] = bins(&sensor.colors, [slopes[0][x].into(), slopes[1][x].into()]);
            let is_edge = |at: f64| (at - at.round()).abs() < 2e-3;
            let part = match () {
                () if steepness < 1.0 => Part::Gentle,
                () if is_edge(steepness) || is_edge(direction) => Part::Edge,
                () => Part::Rest,
            };
            let off = |channel: usize| {
                let rest = f64::from(sensor.background.get_pixel(x as u32, y as u32)[channel]);
                let ours = (rest + f64::from(change[channel][x])).clamp(0.0, 255.0).round();
                (ours - case.picture[3 * (y * width + x) + channel]).abs()
            };
            let off = [0, 1, 2].map(off).into_iter().fold(0.0, f64::max);
            let agreement = &mut found.iter_mut().find(|(of, _)| *of == part).expect("every part is there").1;
            agreement.pixels += 1;
            agreement.beyond += usize::from(off > 2.0);
            agreement.worst = agreement.worst.max(off);
            agreement.sum += off;
        }
    }
    found
}

#[test]
fn pictures_agree_with_the_packages_within_2_grey_levels() {
    let Some(root) = std::env::var_os("GELSIM_TAXIM") else {
        println!("left out: GELSIM_TAXIM does not name a folder that tests/python/test_taxim.py made");
        return;
    };
    let root = Path::new(&root);
    for sensor in ["gelsight", "gelsight_mini"] {
        let imported = import_taxim_folder(&root.join(sensor)).unwrap_or_else(|report| panic!("{report}"));
        for shape in ["sphere", "smooth", "steep"] {
            let parts = compare(&imported, &Case::read(&root.join(sensor).join(format!("{shape}.npz"))));
            for (part, Agreement { pixels, beyond, worst, sum }) in parts {
                let mean = sum / pixels.max(1) as f64;
                println!("{sensor} {shape} {part:?}: {pixels} px, {beyond} beyond 2, worst {worst:.2}, mean {mean:.2}");
            }
            let of = |part| parts.iter().find(|(of, _)| *of == part).expect("every part is there").1;
            let (rest, edge) = (of(Part::Rest), of(Part::Edge));
            assert!(rest.pixels > 20_000, "{sensor} {shape}: {rest:?}");
            assert!(rest.worst <= 2.0, "{sensor} {shape}: {rest:?}");
            assert!(edge.beyond * 200 <= rest.pixels, "{sensor} {shape}: {edge:?}");
        }
    }
}
