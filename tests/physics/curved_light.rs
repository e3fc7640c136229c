//! Light on gels that are not flat: shadows of a pressed skin on itself against rays, and saw-teeth against pictures of three times
//! the resolution.

use gelsim::SensorExt;
use std::sync::Arc;

use gelsim::{Background, Effect, EffectPolicy, Fidelity, Impression, Indenter, Models, Pose, Sensor, Simulator};
use gelsim_core::base::chart::Chart;
use gelsim_core::base::gel::{GelDome, GelShape};
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::camera::projection::LensModel;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::optics::Model;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::phong::{Phong, Shadows};
use glam::DVec3;

use gelsim_oracle::shapes::Shape;

/// The sensor without what its camera does to light.
fn sensor(name: &str, px: [usize; 2]) -> Sensor {
    let mut sensor = Sensor::preset(name).expect("a preset");
    sensor.resolution_px = px;
    sensor.camera.read_noise_levels = 0.0;
    sensor.camera.defocus_mm = 0.0;
    sensor.darkening = 0.0;
    sensor
}

fn simulator_of(sensor: &Sensor, policy: EffectPolicy) -> Simulator {
    let models = Fidelity::High.models(sensor.light_source());
    Simulator::with_models(sensor.clone(), models, policy)
}

fn object(name: &str) -> Arc<Clusters> {
    let path = format!("{}/objects/{name}.obj", env!("CARGO_MANIFEST_DIR"));
    Arc::new(Shape::bundled(std::path::Path::new(&path)).clusters())
}

/// Presses an object in so deep in a place over the gel, its lowest point first.
fn press(
    simulator: &Simulator,
    object: &Arc<Clusters>,
    depth_mm: f64,
    [from_tip_mm, around_deg]: [f64; 2],
) -> Impression {
    let (axes, origin_mm) = simulator.sensor().shape.as_ref().expect("it has one").frame_at(from_tip_mm, around_deg);
    let lowest_mm = -object.extreme([0.0, 0.0, -1.0]) + object.centre_mm()[2];
    let pose = Pose::from_quaternion([0.0, 0.0, 0.3, 1.0], [0.0, 0.0, -lowest_mm - depth_mm]).within(axes, origin_mm);
    simulator.press(&Indenter::clusters(Arc::clone(object), pose))
}

fn differences(a: &[u8], b: &[u8]) -> Vec<u8> {
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).collect()
}

/// A pressed skin in f64: its displacement on the chart of the contact.
struct Skin<'a> {
    shape: &'a GelShape,
    chart: Chart,
    view: View,
    surface: &'a Grid<f32>,
    most_mm: f64,
}

impl Skin<'_> {
    fn displaced_mm(&self, place: [f64; 2]) -> f64 {
        let [x, y] = [0, 1].map(|k| place[k] / self.view.mm_per_px[k] + 0.5 * self.view.resolution_px[k] as f64 + 0.5);
        let (width, height) = (self.surface.width as f64 - 1.001, self.surface.height as f64 - 1.001);
        if !(x >= 0.0 && y >= 0.0 && x < width && y < height) {
            return 0.0;
        }
        let (column, row) = (x as usize, y as usize);
        let (u, v) = (x - column as f64, y - row as f64);
        let at = |x: usize, y: usize| f64::from(self.surface.at(x, y));
        let line = |y: usize| at(column, y) * (1.0 - u) + at(column + 1, y) * u;
        line(row) * (1.0 - v) + line(row + 1) * v
    }

    /// True if something of the skin stands between a point over it and an LED.
    fn blocks(&self, from: DVec3, towards: DVec3) -> bool {
        const STEP_MM: f64 = 0.05;
        (2..400).map(|step| from + f64::from(step) * STEP_MM * towards).find_map(|at| {
            let site = self.shape.closest(at);
            let below_mm = (site.point_mm - at).dot(site.normal);
            if below_mm > self.most_mm {
                return Some(false);
            }
            (self.displaced_mm(self.chart.locate_site(site)) > below_mm + 1e-3).then_some(true)
        }) == Some(true)
    }

    /// The share of an LED inside the gel that a point of the skin sees, of rays over its angular size.
    fn share(&self, from: DVec3, normal: DVec3, led: &Led) -> f64 {
        let to_led = (DVec3::from_array(led.position_mm.expect("inside")) - from).normalize();
        // Along the skin, and over it.
        let across = to_led.cross(normal).normalize();
        let up = across.cross(to_led).normalize();
        let up = if up.dot(normal) > 0.0 { up } else { -up };
        let mut seen = 0.0;
        for k in 0..5 {
            for j in 0..3 {
                let [wide, high] = [(f64::from(j) - 1.0) / 3.0, (f64::from(k) - 2.0) / 5.0];
                let [wide, high] = [wide * led.angular_size_deg[0], high * led.angular_size_deg[1]];
                let ray = to_led + across * wide.to_radians().tan() + up * high.to_radians().tan();
                seen += f64::from(u8::from(!self.blocks(from, ray.normalize())));
            }
        }
        seen / 15.0
    }
}

/// What shadows take from each pixel, in levels, by rays; pixels that are looked at.
fn shadows_by_rays(found: &Impression, simulator: &Simulator, place: [f64; 2], every: usize) -> Vec<(usize, [f64; 3])> {
    let sensor = simulator.sensor();
    let shape = sensor.shape.as_ref().expect("it has one");
    let (axes, origin_mm) = shape.frame_at(place[0], place[1]);
    let site = shape.closest(origin_mm + 1e-6 * axes.z_axis);
    let [lowest, highest] = found.contact.range_mm();
    let skin = Skin {
        shape,
        chart: Chart::around_site(shape, site),
        view: *simulator.view(),
        surface: &found.contact.surface,
        most_mm: f64::from(highest.max(-lowest)) + 1e-3,
    };
    let phong = simulator.models().optics.phong().copied().unwrap_or_default();
    let camera = sensor.projection();
    let (points, normals) = (found.points_mm(), found.normals());
    let near = |at: &usize| {
        let point = DVec3::from_array(points[*at].map(f64::from));
        point != DVec3::ZERO && point.distance(origin_mm) < 9.0
    };
    let taken = |at: usize| {
        let point = DVec3::from_array(points[at].map(f64::from));
        let normal = DVec3::from_array(normals[at].map(f64::from));
        let to_camera = camera.towards_camera(point);
        let mut taken = [0.0; 3];
        for led in &sensor.leds {
            let position = DVec3::from_array(led.position_mm.expect("inside"));
            let to_led = (position - point).normalize();
            let strength = position.length_squared() / position.distance_squared(point);
            let along = normal.dot(to_led);
            if along <= 0.0 {
                continue;
            }
            let mirrored = 2.0 * along * normal.dot(to_camera) - to_led.dot(to_camera);
            let given = phong.diffuse * along + phong.specular * mirrored.max(0.0).powf(phong.shininess);
            let hidden = 1.0 - skin.share(point + 0.01 * normal, normal, led);
            let lost = 255.0 * hidden * strength * given * led.intensity;
            taken.iter_mut().zip(led.color).for_each(|(sum, share)| *sum += lost * share);
        }
        (at, taken)
    };
    (0..points.len()).filter(near).step_by(every).map(taken).collect()
}

/// How large the shadows are that LEDs inside the gel would cast, and are left out.
#[test]
fn shadows_of_leds_inside_a_gel_are_left_out_and_are_small_by_rays() {
    let sensor = sensor("allsight", [120, 90]);
    let simulator = simulator_of(&sensor, EffectPolicy::default());
    let presses = [("sphere", 1.0, [26.0, 0.0]), ("cube", 0.8, [24.0, 50.0]), ("cube", 0.8, [3.0, 0.0])];
    for (name, depth_mm, place) in presses {
        let found = press(&simulator, &object(name), depth_mm, place);
        assert!(!found.effects.notes[Effect::Shadows].ran);
        let (mut sum, mut squares, mut most, mut count) = (0.0, 0.0, 0.0_f64, 0);
        for (at, taken) in shadows_by_rays(&found, &simulator, place, 2) {
            for (k, taken) in taken.into_iter().enumerate() {
                let level = f64::from(found.image.rgb[3 * at + k]);
                // What is cut at white or black says nothing.
                if level <= 250.0 && level - taken >= 1.0 {
                    (sum, squares, most, count) = (sum + taken, squares + taken * taken, most.max(taken), count + 1);
                }
            }
        }
        let [mean, square] = [sum, squares].map(|sum| sum / f64::from(count));
        println!(
            "shadows of a {name} at {place:?} by rays, {count} values around it: {mean:.2} levels on average, {:.2} RMS, {most:.0} at most",
            square.sqrt()
        );
        assert!(count > 100 && mean < 2.0 && square.sqrt() < 9.0, "{name}: {count} values, {mean}, {square}");
    }
}

/// A dome of a kilometre, lit from its rim, has the flat pad's shadows.
#[test]
fn shadows_on_a_dome_of_a_kilometre_are_those_on_a_flat_pad() {
    let mut flat = Sensor::preset("gelsight-2014").expect("a preset");
    flat.resolution_px = [120, 90];
    flat.field_of_view_mm = [16.0, 12.0];
    flat.leds.iter_mut().for_each(|led| led.elevation_deg = 12.0);
    let Background::Rendered(look) = &mut flat.background else { panic!("rendered") };
    look.glow = 0.0;
    let mut dome = flat.clone();
    dome.shape = Some(GelShape::Dome(GelDome { radius_mm: 1e6 }));
    dome.lens = LensModel::Orthographic;
    let models = || Models { optics: Model::Phong(Phong::default()), ..Fidelity::High.models(flat.light_source()) };
    let policy = EffectPolicy::Without(Effect::Supersampling);
    let ball = Arc::new(Shape::ball_around_origin(4.0, 192, 96).clusters());
    let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [1.0, 0.5, 4.0 - 1.0]);
    let found = [&flat, &dome].map(|sensor| {
        let simulator = Simulator::with_models(sensor.clone(), models(), policy);
        simulator.press(&Indenter::clusters(Arc::clone(&ball), pose))
    });
    assert!(found.iter().all(|found| found.effects.notes[Effect::Shadows].ran));
    let off = differences(&found[0].image.rgb, &found[1].image.rgb);
    let most = off.iter().max().copied().unwrap_or(0);
    let few = off.iter().filter(|off| **off > 1).count();
    println!(
        "shadows on a dome of a kilometre: {most} levels off the flat pad's, {few} of {} values by more than one",
        off.len()
    );
    assert!(most <= 3 && few * 500 < off.len(), "{most} levels, {few} of {}", off.len());
}

/// A picture, and one of three times the resolution on average over three by three pixels; no shadows in either.
#[test]
fn light_on_a_finger_is_nearer_to_that_of_finer_pictures_where_it_is_averaged() {
    let coarse = sensor("geltip", [160, 120]);
    let fine = coarse.clone().with_resolution([480, 360]);
    let without_shadows = |sensor: &Sensor, policy: EffectPolicy| {
        let models = Fidelity::High.models(sensor.light_source());
        let phong = Phong { shadows: Shadows::None, ..models.optics.phong().copied().expect("LEDs") };
        Simulator::with_models(sensor.clone(), Models { optics: Model::Phong(phong), ..models }, policy)
    };
    let centres = EffectPolicy::Without(Effect::Supersampling);
    let reference = without_shadows(&fine, centres);
    let simulators = [centres, EffectPolicy::default()].map(|policy| without_shadows(&coarse, policy));
    for (name, place) in [("cube", [24.0, 30.0]), ("hexagon_nut", [14.0, 0.0]), ("letter", [26.0, 200.0])] {
        let object = object(name);
        let changes = |simulator: &Simulator| -> Vec<f64> {
            let found = press(simulator, &object, 0.8, place);
            let levels = found.image.rgb.iter().zip(&simulator.untouched().rgb);
            levels.map(|(pressed, untouched)| f64::from(*pressed) - f64::from(*untouched)).collect()
        };
        let exact = changes(&reference);
        let mean = |at: usize| {
            let (k, px) = (at % 3, at / 3);
            let (x, y) = (3 * (px % 160), 3 * (px / 160));
            (0..9).map(|n| exact[3 * ((y + n / 3) * 480 + x + n % 3) + k]).sum::<f64>() / 9.0
        };
        let expected: Vec<f64> = (0..160 * 120 * 3).map(mean).collect();
        let touched = expected.iter().filter(|change| change.abs() > 1.0).count();
        let [plain, averaged] = simulators.each_ref().map(|simulator| {
            let square = |(a, b): (f64, &f64)| (a - b) * (a - b);
            (changes(simulator).into_iter().zip(&expected).map(square).sum::<f64>() / touched as f64).sqrt()
        });
        println!(
            "saw-teeth of a {name} at {place:?}: {plain:.2} levels RMS over {touched} values that the press changes, {averaged:.2} averaged"
        );
        // What is left lies between the chart's nodes, which are fewer, too.
        assert!(touched > 100 && averaged < plain, "{touched} px: {averaged}, {plain}");
    }
}
