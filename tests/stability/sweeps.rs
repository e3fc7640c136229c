//! Walks through the places where the code changes its way of working: no step may stand out.
//!
//! A pad does not move more than what presses it, so from one step in depth to the next its surface moves by little more
//! than the step, and by what the solver tolerates. On a coarser grid it may jump besides, where a pixel of that grid
//! comes to touch: by up to a twentieth of the distance between them.

use gelsim_core::depth;
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad;
use gelsim_core::simulator::Stages;
use gelsim_job::plan::Plan;
use gelsim_job::scene::Scene;

use super::press::{Change, GENERIC, Numbers, Setting, Shown, levels, press_unlabelled};

const NO_SHADOWS: &str = "optics.phong.shadows = 'none'\n";
/// Distance between pixels in a view of 20 mm and 80 px.
const PITCH_MM: f64 = 0.25;

/// The most that changes from step to step of a walk from 0 to 1.
fn largest_step(steps: u32, shown: impl Fn(f64) -> Shown) -> Change {
    let mut last = shown(0.0);
    (1..=steps).fold(Change::default(), |most, step| {
        let now = shown(f64::from(step) / f64::from(steps));
        let change = last.change(&now);
        last = now;
        most.or(change)
    })
}

/// By how much a surface may move, um, when an object goes `step_um` deeper.
fn allowed_um(level: Fidelity, step_um: f64, pitch_mm: f64) -> f64 {
    let (tolerance_um, factor) = match level {
        Fidelity::Paper => (0.01, 0.0),
        Fidelity::Draft => (3.0, 4.0),
        Fidelity::Standard => (1.0, 2.0),
        Fidelity::High | Fidelity::FiniteStrain => (1.0, 0.0),
        Fidelity::Reference => (0.05, 0.0),
    };
    // Incompressible pads give way beside the object by more than it moves.
    2.0 * step_um + tolerance_um + 50.0 * factor * pitch_mm
}

/// The sample of a plan with its object `lower_mm` deeper, without print and lens.
fn lowered(plan: &Plan, lower_mm: f64) -> Shown {
    let scene = Scene::draw(plan, 0, 0);
    let mut placement = scene.pose.placement();
    placement.translation_mm[2] -= lower_mm;
    let mut effects = EffectLog::new(EffectPolicy::WhereNeeded);
    let window = plan.simulator.pad().capture_window((scene.indentation_depth_mm + lower_mm).max(0.0));
    let object = &plan.sampling.objects[0].geometry.clusters();
    let depth = depth::capture_mesh(object, &placement, plan.simulator.view(), window, plan.thickness_mm());
    let contact = gelpad::deform_pad(plan.simulator.pad(), &depth, None, None, false, &mut effects);
    let light = plan.simulator.shader().shade(&contact, plan.simulator.background(), &mut effects).into_light();
    let light_levels = levels(plan, &light);
    let image = plan.simulator.camera().expose(light.into(), Some(&contact.mask), None, &scene.camera, &mut effects);
    Shown { depth: depth.below_pad(), surface: contact.surface, light: light_levels, rgb: image.rgb }
}

#[test]
fn first_contact_comes_gradually() {
    // From 0.5 um above the pad to 0.5 um below, pixels of 0.05 mm: it begins with single pixels.
    for level in Fidelity::ALL {
        for object in ["sphere", "torus", "cube", "coin"] {
            let more = "sensor.field_of_view_mm = [4.0, 3.0]\n";
            let setting = Setting { object, level, more, anchor: "contact", ..Setting::default() };
            let plan = setting.plan(&Numbers { depth_mm: 0.0, tilt_deg: 0.02, x_mm: 0.2, ..GENERIC });
            let (away, touching) = (lowered(&plan, -5e-4), lowered(&plan, 5e-4));
            assert!(away.surface.data.iter().all(|w| *w == 0.0) && away.rgb == plan.simulator.untouched().rgb);
            assert!(away.change(&touching).surface_um > 0.2, "{object}, {level:?}: it touches");
            let change = largest_step(40, |t| lowered(&plan, 1e-3 * (t - 0.5)));
            println!("first contact, {object}, {level:?}: {change:?}");
            assert!(change.surface_um < allowed_um(level, 0.025, 0.0), "{object}, {level:?}: {change:?}");
            assert!(change.light_levels < 1.0 && change.image_levels <= 1, "{object}, {level:?}: {change:?}");
        }
    }
}

#[test]
fn a_step_in_depth_moves_the_surface_by_little_more() {
    // Grazing; through the depth at which the penetration's box gets so large that a coarser grid is tried first;
    // through half of the pad's thickness, where the theory ends; down to the shell.
    let steps = if crate::thorough() { 20 } else { 8 };
    for (from_mm, to_mm) in [(0.01, 0.015), (0.3, 0.32), (1.4555, 1.4755), (2.91, 2.93)] {
        for level in Fidelity::ALL {
            // Rubber at finite strain takes seconds where it is pressed deep.
            let few = level == Fidelity::FiniteStrain && !crate::thorough();
            for object in ["sphere", "torus", "coin"] {
                if few && (from_mm > 1.0 || object != "sphere") {
                    continue;
                }
                let setting = Setting { object, level, more: NO_SHADOWS, ..Setting::default() };
                let at = |t: f64| Numbers { depth_mm: from_mm + (to_mm - from_mm) * t, ..GENERIC };
                let change = largest_step(steps, |t| setting.press(&at(t)));
                println!("depth {from_mm} .. {to_mm} mm, {object}, {level:?}: {change:?}");
                let step_um = 1e3 * (to_mm - from_mm) / f64::from(steps);
                // At finite strain, nodes under a wall may take or leave the contact within the tolerance.
                let beside_walls_um = if level == Fidelity::FiniteStrain && object == "coin" { 12.0 } else { 0.0 };
                let most_um = allowed_um(level, step_um, PITCH_MM) + beside_walls_um;
                assert!(change.surface_um < most_um, "{object}, {level:?}: {change:?}");
                let bound = 1.2 + 0.6 * change.surface_um;
                assert!(change.light_levels < bound, "{object}, {level:?}: {change:?}");
            }
        }
    }
}

#[test]
fn a_step_in_depth_moves_shadows_by_few_levels() {
    for level in [Fidelity::Draft, Fidelity::Standard, Fidelity::High] {
        for model in ["phong", "led"] {
            for object in ["sphere", "torus", "coin"] {
                let more = format!("optics.{model} = {{}}\n");
                let setting = Setting { object, level, more: &more, ..Setting::default() };
                let at = |t: f64| Numbers { depth_mm: 0.5 + 0.02 * t, led_azimuth_deg: 45.0, ..GENERIC };
                let change = largest_step(20, |t| setting.press(&at(t)));
                println!("shadows in depth, {model}, {object}, {level:?}: {change:?}");
                let bound = 12.0 + 0.45 * change.surface_um;
                assert!(change.light_levels < bound && change.image_share < 0.075, "{object}, {level:?}: {change:?}");
            }
        }
    }
}

#[test]
fn crossing_the_size_from_which_a_coarser_grid_is_tried_first_does_not_show() {
    // A ball whose penetration's box grows through 64 x 64 px.
    let more = "sensor.field_of_view_mm = [10.0, 7.5]\noptics.phong.shadows = 'none'\n";
    let setting = Setting { level: Fidelity::High, resolution_px: [160, 120], more, ..Setting::default() };
    let at = |t: f64| Numbers { depth_mm: 0.5 + 0.08 * t, ..GENERIC };
    let area = |t: f64| {
        let plan = setting.plan(&at(t));
        press_unlabelled(&plan).depth.touching.area()
    };
    assert!(area(0.0) <= 64 * 64 && area(1.0) > 64 * 64, "{} {}", area(0.0), area(1.0));
    let change = largest_step(40, |t| setting.press(&at(t)));
    println!("box of 64 x 64 px: {change:?}");
    assert!(change.surface_um < allowed_um(Fidelity::High, 2.0, 0.0), "{change:?}");
}

/// True if the press makes the pad bulge up to where nothing is known of the object.
fn looks_higher(plan: &Plan) -> bool {
    let (scene, pad) = (Scene::draw(plan, 0, 0), plan.simulator.pad());
    let window = pad.capture_window(scene.indentation_depth_mm);
    let mut effects = EffectLog::new(EffectPolicy::WhereNeeded);
    let press = scene.to_press(plan);
    let (view, drop_mm) = (plan.simulator.view(), plan.simulator.drop_mm());
    let depth = depth::capture_penetration(
        &press.indenter,
        press.texture.as_ref(),
        drop_mm,
        plan.thickness_mm(),
        view,
        window,
        &mut effects,
    );
    let contact = gelpad::deform_pad(pad, &depth, None, None, false, &mut effects);
    pad.higher_window(window, &contact).is_some()
}

#[test]
fn looking_higher_because_of_a_bulge_does_not_show() {
    let mut looked = [0; 2];
    let steps = if crate::thorough() { 30 } else { 12 };
    for level in [Fidelity::Draft, Fidelity::Standard, Fidelity::High, Fidelity::Reference] {
        for object in ["washer", "torus", "gear", "letter"] {
            let setting = Setting { level, object, more: NO_SHADOWS, ..Setting::default() };
            let at = |t: f64| Numbers {
                depth_mm: 5e-4 + 0.015 * t,
                poisson_ratio: 0.4999,
                tilt_deg: 0.0,
                thickness_mm: 1.2,
                ..GENERIC
            };
            for t in [0.0, 0.3, 0.6, 1.0] {
                looked[usize::from(looks_higher(&setting.plan(&at(t))))] += 1;
            }
            let change = largest_step(steps, |t| setting.press(&at(t)));
            println!("bulges, {object}, {level:?}: {change:?}");
            // So shallow that a coarse grid's jumps are no larger than the depth.
            let bound = allowed_um(level, 15.0 / f64::from(steps), 0.0)
                + if level == Fidelity::Standard || level == Fidelity::Draft { 5.0 } else { 0.0 };
            assert!(change.surface_um < bound, "{object}, {level:?}: {change:?}");
        }
    }
    assert!(looked.iter().all(|times| *times > 5), "both happen: {looked:?}");
}

#[test]
fn beside_a_shallow_press_the_pad_does_not_rise_to_a_flank_that_it_does_not_touch() {
    for level in [Fidelity::Draft, Fidelity::Standard] {
        for object in ["letter", "gear", "washer", "cube", "coin"] {
            for depth_mm in [5e-4, 5e-3, 0.02] {
                let setting = Setting { level, object, ..Setting::default() };
                let plan = setting.plan(&Numbers { depth_mm, tilt_deg: 0.0, thickness_mm: 1.2, ..GENERIC });
                let contact = press_unlabelled(&plan).contact;
                let highest = contact.surface.data.iter().fold(0.0_f32, |highest, w| highest.max(-w));
                // Interpolation may overshoot a little.
                let allowed = 1.5 * contact.bulge_mm + 1e-6;
                assert!(highest <= allowed, "{object}, {level:?}, {depth_mm} mm: {highest} over {}", contact.bulge_mm);
            }
        }
    }
}

#[test]
fn a_press_shallower_than_the_tolerance_has_a_force_in_proportion_to_its_depth() {
    let stiffness = |level: Fidelity, depth_mm: f64| {
        let setting = Setting { level, object: "cube", ..Setting::default() };
        let contact = press_unlabelled(&setting.plan(&Numbers { depth_mm, tilt_deg: 0.0, ..GENERIC })).contact;
        contact.force_n.expect("an elastic pad knows it") / depth_mm
    };
    let exact = stiffness(Fidelity::Reference, 0.02);
    for level in [Fidelity::Draft, Fidelity::Standard, Fidelity::High, Fidelity::Reference] {
        for depth_mm in [1e-4, 1e-3, 1e-2] {
            let ratio = stiffness(level, depth_mm) / exact;
            println!("{level:?}, {depth_mm} mm: {ratio:.3} of the reference's stiffness");
            // Coarse grids see a cube whose sides are up to half of their pixels off.
            assert!((ratio - 1.0).abs() < 0.13, "{level:?}, {depth_mm} mm: {ratio}");
        }
    }
}

#[test]
fn where_the_pads_response_is_computed_otherwise_the_surface_hardly_jumps() {
    // Thicknesses at which the window grows by four pixels, the response is averaged more finely over a pixel, or its end
    // stands for the tail, or the nodes of its far field lie further apart; and one at which nothing happens.
    for (what, thickness_mm, depth_mm, bound_um) in [
        ("four pixels more of margin", 10.0 / 3.0, 0.5, 6.0),
        ("finer pixels than a 32nd", 8.0, 0.5, 0.05),
        ("a wide window", 23.5 / 22.5, 0.2, 0.05),
        ("nodes further apart", 10.0, 0.5, 0.3),
        ("nothing", 3.333, 0.5, 0.01),
    ] {
        for level in [Fidelity::Draft, Fidelity::Standard, Fidelity::High, Fidelity::Reference] {
            for object in ["cube", "wave", "torus"] {
                let setting = Setting { level, object, more: NO_SHADOWS, ..Setting::default() };
                let at = |t: f64| Numbers {
                    depth_mm,
                    thickness_mm: thickness_mm * (1.0 + 2e-9 * (t - 0.5)),
                    x_mm: 8.7,
                    ..GENERIC
                };
                let change = largest_step(1, |t| setting.press(&at(t)));
                println!("{what}, {object}, {level:?}: {change:?}");
                assert!(change.surface_um < bound_um, "{what}, {object}, {level:?}: {change:?}");
            }
        }
    }
}

#[test]
fn an_effect_of_hardly_any_strength_hardly_shows() {
    for level in [Fidelity::Paper, Fidelity::Standard] {
        for (line, other) in [
            ("camera.distortion_k1 = 1e-9", ""),
            ("camera.distortion_k2 = -1e-9", ""),
            ("camera.defocus_mm = 1e-9", ""),
            ("camera.vignette = 1e-9", ""),
            ("camera.exposure = 1.000000001", ""),
            ("camera.red_gain = 1.000000001", ""),
            ("texture = { patterns = ['noise'], amplitude_mm = 1e-9 }", ""),
            ("markers.diameter_mm = 1e-9", ""),
            ("markers = {}\nshear.x_mm = 1e-9", "markers = {}"),
            ("markers = {}\nshear = { x_mm = 1e-9, friction = { coulomb = { coefficient = 0.4 } } }", "markers = {}"),
            ("markers = {}\nshear = { x_mm = 0.2, friction = { coulomb = { coefficient = 1e-9 } } }", "markers = {}"),
            ("sensor.grain = { height_um = 1e-9, size_mm = 0.4 }", ""),
            ("optics.phong.darkening = 1e-9", "optics.phong.darkening = 0.0"),
            ("optics.phong.shininess = 5.00001", "optics.phong.shininess = 5.0"),
            ("optics.phong.shininess = 64.00001", "optics.phong.shininess = 64.0"),
            ("optics.phong.shininess = 0.99999", "optics.phong.shininess = 1.0"),
            ("optics.phong.ambient = 0.999999999", "optics.phong.ambient = 1.0"),
        ] {
            let [a, b] = [line, other].map(|line| {
                let more = format!("{line}\n");
                Setting { level, object: "gear", more: &more, ..Setting::default() }.press(&GENERIC)
            });
            let change = a.change(&b);
            println!("{level:?}, {line}: {change:?}");
            assert!(change.surface_um < 0.01 && change.light_levels < 0.5, "{level:?}, {line}: {change:?}");
            assert!(change.image_levels <= 1 && change.image_share < 0.02, "{level:?}, {line}: {change:?}");
        }
    }
}

#[test]
fn a_dot_looks_much_the_same_on_either_side_of_the_size_from_which_it_is_drawn_more_finely() {
    // Radii of 4, 2 and 1 px, at which the ramp of the edge becomes narrower and pixels are averaged instead.
    for (diameter_mm, bound) in [(2.0, 25), (1.0, 12), (0.5, 4)] {
        let [a, b] = [-1e-6, 1e-6].map(|more_mm| {
            let more = format!("markers = {{ pitch_mm = 2.6, diameter_mm = {:?} }}\n", diameter_mm + more_mm);
            Setting { object: "gear", more: &more, ..Setting::default() }.press(&GENERIC)
        });
        let change = a.change(&b);
        println!("dots of {diameter_mm} mm: {change:?}");
        assert!(change.image_levels <= bound, "{diameter_mm} mm: {change:?}");
    }
}
