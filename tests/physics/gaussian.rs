//! The surfaces of the pyramid of Gaussians and of the pad that does not deform, against sums written out.

use gelsim_core::base::grid::{Grid, bounding_box};
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::gelpad::gaussian::Gaussian;
use gelsim_core::gelpad::no_deformation::NoDeformation;
use gelsim_core::gelpad::{Contact, Model, Pad};

use super::rig::Setup;
use super::support::{camera_of, depth_of};
use gelsim_oracle::shapes::Random;

fn pad(model: Model) -> Pad {
    let sensor = gelsim_files::sensor::Sensor::default();
    Pad::new(&model, &sensor.gelpad_material(), &camera_of(&sensor))
}

fn pyramids() -> [Gaussian; 4] {
    let pyramid = |kernels_px: &[u32], smoothing_px| Gaussian { kernels_px: kernels_px.to_vec(), smoothing_px };
    [Gaussian::default(), pyramid(&[9, 3], 1), pyramid(&[], 7), pyramid(&[21, 1], 5)]
}

/// A window of noise lumps and flat faces, some beyond every border.
fn rough(width: usize, height: usize, seed: u64) -> Grid<f32> {
    let mut random = Random(seed);
    let mut grid: Grid<f32> = Grid::new(width, height);
    for lump in 0..12 {
        let [x, y] = [random.within(0.0, width as f64), random.within(0.0, height as f64)];
        let (size, mm) = (random.within(1.0, 9.0), random.within(0.1, 1.0));
        for v in 0..height {
            for u in 0..width {
                let away = (u as f64 - x).hypot(v as f64 - y);
                let value = if lump % 2 == 0 { mm } else { mm * (1.0 - away / size) };
                if away < size {
                    grid.row_mut(v)[u] = grid.at(u, v).max(value as f32);
                }
            }
        }
    }
    grid
}

/// A Gaussian of OpenCV's choice of width, in two dimensions, summed up.
fn blurred(image: &Grid<f64>, width: u32) -> Grid<f64> {
    let reach = i64::from(width / 2);
    let sigma = 0.3 * ((f64::from(width) - 1.0) * 0.5 - 1.0) + 0.8;
    let bell = |k: i64| (-0.5 * (k * k) as f64 / (sigma * sigma)).exp();
    let sum: f64 = (-reach..=reach).map(bell).sum();
    let mut out = Grid::new(image.width, image.height);
    for y in 0..image.height as i64 {
        for x in 0..image.width as i64 {
            let mut total = 0.0;
            for v in (y - reach).max(0)..=(y + reach).min(image.height as i64 - 1) {
                for u in (x - reach).max(0)..=(x + reach).min(image.width as i64 - 1) {
                    total += bell(u - x) * bell(v - y) * image.at(u as usize, v as usize);
                }
            }
            out.row_mut(y as usize)[x as usize] = total / (sum * sum);
        }
    }
    out
}

#[test]
fn the_pyramid_is_what_its_paper_says_summed_up_in_f64() {
    let mut worst = 0.0_f64;
    for (seed, pyramid) in pyramids().into_iter().enumerate() {
        let pad = pad(Model::Gaussian(pyramid.clone()));
        let margin = pad.capture_window(0.0).margin_px;
        let penetration = rough(50 + 2 * margin, 38 + 2 * margin, seed as u64);
        let contact = pad.press(&depth_of(penetration.clone(), margin));
        let object = Grid {
            data: penetration.data.iter().map(|mm| f64::from(*mm)).collect(),
            width: penetration.width,
            height: penetration.height,
        };
        let mut surface = object.clone();
        for kernel in &pyramid.kernels_px {
            surface = blurred(&surface, *kernel);
            for (surface, object) in surface.data.iter_mut().zip(&object.data) {
                *surface = if *object > 0.0 { *object } else { *surface };
            }
        }
        surface = blurred(&surface, pyramid.smoothing_px);
        for y in 0..contact.surface.height {
            for x in 0..contact.surface.width {
                let expected = surface.at(x + margin - SURFACE_BORDER, y + margin - SURFACE_BORDER);
                let error = (f64::from(contact.surface.at(x, y)) - expected).abs();
                worst = worst.max(error);
                // Sums of 51 values below 1, five times over.
                assert!(error < 2e-6, "{pyramid:?} at {x}, {y}: off by {error}");
            }
        }
    }
    println!("gaussian: off by {worst:.1e} mm");
}

#[test]
fn the_contact_keeps_the_objects_shape_but_for_the_last_blur() {
    for seed in 10..14 {
        let pyramid = Gaussian { kernels_px: vec![21, 9], smoothing_px: 1 };
        let pad = pad(Model::Gaussian(pyramid));
        let margin = pad.capture_window(0.0).margin_px;
        let penetration = rough(50 + 2 * margin, 38 + 2 * margin, seed);
        let contact = pad.press(&depth_of(penetration.clone(), margin));
        let mut touching = 0;
        for y in 0..38 {
            for x in 0..50 {
                let object = penetration.at(x + margin, y + margin);
                let surface = contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
                assert_eq!(contact.mask.at(x, y), if object > 0.0 { 255 } else { 0 });
                assert!(object <= 0.0 || surface == object, "{surface} instead of {object}");
                touching += usize::from(object > 0.0);
            }
        }
        assert!(touching > 50, "{touching}");
    }
}

#[test]
fn a_plate_wider_than_the_window_stays_a_plate() {
    for pyramid in pyramids() {
        let pad = pad(Model::Gaussian(pyramid.clone()));
        let margin = pad.capture_window(0.0).margin_px;
        let mut penetration = Grid::new(30 + 2 * margin, 20 + 2 * margin);
        penetration.data.fill(0.7);
        let contact = pad.press(&depth_of(penetration, margin));
        // 102 roundings of 2^-24.
        assert!(contact.surface.data.iter().all(|mm| (mm - 0.7).abs() < 3e-6), "{pyramid:?}");
    }
}

#[test]
fn a_symmetric_object_gives_a_symmetric_surface() {
    for pyramid in pyramids() {
        let pad = pad(Model::Gaussian(pyramid.clone()));
        let margin = pad.capture_window(0.0).margin_px;
        let size = 60 + 2 * margin;
        let middle = (size - 1) as f32 / 2.0;
        let mut penetration = Grid::new(size, size);
        for y in 0..size {
            for x in 0..size {
                let (u, v) = ((x as f32 - middle).abs(), (y as f32 - middle).abs());
                let inside = u.max(v) < 18.0 && u.min(v) < 11.0;
                penetration.row_mut(y)[x] = if inside { 1.3 - 0.002 * u.max(v) * u.min(v) } else { 0.0 };
            }
        }
        let surface = pad.press(&depth_of(penetration, margin)).surface;
        let last = surface.width - 1;
        for y in 0..surface.height {
            for x in 0..surface.width {
                for (u, v) in [(last - x, y), (x, last - y), (y, x)] {
                    let away = (surface.at(u, v) - surface.at(x, y)).abs();
                    assert!(away < 1e-6, "{pyramid:?} at {x}, {y}: {away}");
                }
            }
        }
    }
}

fn same(a: &Contact, b: &Contact) -> bool {
    let bits = |contact: &Contact| contact.surface.data.iter().map(|mm| mm.to_bits()).collect::<Vec<u32>>();
    bits(a) == bits(b) && a.mask == b.mask
}

#[test]
fn a_value_spreads_as_far_as_the_pyramid_reaches_and_no_further() {
    for pyramid in pyramids() {
        let reach = pyramid.reach_px();
        let pad = pad(Model::Gaussian(pyramid.clone()));
        let margin = pad.capture_window(0.0).margin_px;
        assert_eq!(margin, reach + SURFACE_BORDER);
        // A pixel in the outermost corner of the window is still felt in the surface's corner; one in view as far as
        // its region says.
        for at in [0, margin, margin + 15] {
            let mut penetration = Grid::new(30 + 2 * margin, 30 + 2 * margin);
            penetration.row_mut(at)[at] = 0.9;
            let contact = pad.press(&depth_of(penetration, margin));
            let touched = bounding_box(&contact.surface, |mm| mm != 0.0);
            assert_eq!(touched, contact.region, "{pyramid:?}, pixel {at}");
            let [from, to] = [at.saturating_sub(reach), at + reach].map(|px| px.max(reach) - reach);
            assert_eq!([touched.x0, touched.x1 - 1], [from, to.min(31)], "{pyramid:?}, pixel {at}");
        }
    }
}

#[test]
fn what_lies_beyond_the_margin_changes_no_bit_in_view() {
    for (seed, pyramid) in pyramids().into_iter().enumerate() {
        let pad = pad(Model::Gaussian(pyramid.clone()));
        let margin = pad.capture_window(0.0).margin_px;
        let far = margin + 40;
        let all = rough(40 + 2 * far, 30 + 2 * far, 20 + seed as u64);
        let tight = pad.press(&depth_of(all.inner(40), margin));
        let wide = pad.press(&depth_of(all, far));
        assert!(same(&tight, &wide), "{pyramid:?}");
    }
}

#[test]
fn without_deformation_the_surface_is_the_penetration() {
    let pad = pad(Model::None(NoDeformation {}));
    let margin = pad.capture_window(0.0).margin_px;
    for seed in 30..34 {
        let penetration = rough(50 + 2 * margin, 38 + 2 * margin, seed);
        let contact = pad.press(&depth_of(penetration.clone(), margin));
        for y in 0..contact.surface.height {
            for x in 0..contact.surface.width {
                let expected = penetration.at(x + margin - SURFACE_BORDER, y + margin - SURFACE_BORDER).max(0.0);
                assert_eq!(contact.surface.at(x, y), expected, "at {x}, {y}");
            }
        }
        assert!(contact.mask.data.contains(&255));
        for (mask, mm) in contact.mask.data.iter().zip(penetration.inner(margin).data) {
            assert_eq!(*mask, if mm > 0.0 { 255 } else { 0 });
        }
    }
}

#[test]
fn objects_above_the_pad_leave_every_model_untouched() {
    let elastic = Model::Elastic(Setup::default().elastic);
    for model in [Model::None(NoDeformation {}), Model::Gaussian(Gaussian::default()), elastic] {
        let pad = pad(model.clone());
        let margin = pad.capture_window(0.0).margin_px;
        let mut penetration = Grid::new(640 + 2 * margin, 480 + 2 * margin);
        penetration.data.fill(-0.1);
        let contact = pad.press(&depth_of(penetration, margin));
        assert!(contact.region.is_empty() && contact.pressure.is_none(), "{model:?}");
        assert!(contact.surface.data.iter().all(|mm| mm.to_bits() == 0), "{model:?}");
        assert!(contact.mask.data.iter().all(|value| *value == 0), "{model:?}");
    }
}
