//! Time of each stage at 640x480, one thread: `cargo bench -p gelsim-bench --bench stages`.

#[path = "../../src/memory.rs"]
mod memory;
#[path = "../physics/plan.rs"]
mod plan;

use gelsim_core::simulator::Stages;
use std::hint::black_box;
use std::io::Cursor;

use criterion::{BenchmarkId, Criterion, criterion_group};
use gelsim_core::base::grid::Rect;
use gelsim_core::base::rng::random_stream;
use gelsim_core::base::simd::{VectorWidth, with_width_limit};
use gelsim_core::base::view::View;
use gelsim_core::depth::{self, CaptureWindow};
use gelsim_core::effects::{EffectLog, EffectPolicy};
use gelsim_core::gelpad::Pad;
use gelsim_core::gelpad::mean_blur::MeanBlur;
use gelsim_core::mesh::cleaning::Mesh;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::optics::calibrated::response::{CalibrationResponse, INPUTS, OUTPUTS};
use gelsim_core::optics::calibrated::{Calibrated, CalibratedShader, CalibrationTable};
use gelsim_core::pose::Placement;
use gelsim_dataset::encode;
use gelsim_dataset::frames::camera::{DepthCamera, DepthProjection, DepthUnit, DistanceAlong};
use gelsim_dataset::frames::read;
use gelsim_dataset::frames::reader::FrameReader;
use gelsim_dataset::frames::run::render_frame_sample;
use gelsim_files::exr::{Compression, Exr, Pixel};
use gelsim_files::{exr, npy, png};
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use gelsim_job::plan::frames::FrameSettings;
use gelsim_job::sample::render;
use gelsim_job::scene::Scene;
use gelsim_lab::calibrate::{self, Geometry};

const CAMERA: View = View { resolution_px: [640, 480], mm_per_px: [0.03125, 0.03125] };

/// An EXR as the crate `exr` packs it, in ZIP blocks of halves.
fn exr_by_crate(depth: &[f32]) -> Vec<u8> {
    use ::exr::prelude::*;
    let values = depth.iter().map(|mm| f16::from_f32(*mm)).collect();
    let channels = AnyChannels::sort(SmallVec::from([AnyChannel::new("Z", FlatSamples::F16(values))].to_vec()));
    let encoding = Encoding {
        compression: ::exr::compression::Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let layer = Layer::new((640, 480), LayerAttributes::named("layer"), encoding, channels);
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes).expect("writing to memory");
    bytes.into_inner()
}

/// A PNG at the quickest setting of the crate `png`.
fn png_by_crate(rgb: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(rgb.len() / 2);
    let mut encoder = ::png::Encoder::new(&mut bytes, 640, 480);
    encoder.set_color(::png::ColorType::Rgb);
    encoder.set_depth(::png::BitDepth::Eight);
    encoder.set_compression(::png::Compression::Fast);
    encoder.set_filter(::png::Filter::Up);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(rgb));
    written.expect("writing to memory");
    bytes
}

/// What the default model of the pad asks for at a depth of 0.7 mm.
const WINDOW: CaptureWindow = CaptureWindow { margin_px: 144, above_mm: 0.28 };

fn plan(object: &str) -> Plan {
    let text = format!(
        "[dataset]\nname = \"bench\"\nsamples = 1000\n[[object]]\npath = \"objects/{object}.obj\"\n\
         [pose]\nyaw_deg = [0.0, 360.0]\ntilt_deg = [0.0, 3.0]\n[indentation]\ndepth_mm = 0.7\n"
    );
    plan::plan(&text)
}

/// A wavy plate of about `triangles` triangles that fills the window.
fn plate(triangles: usize) -> Clusters {
    let side = ((triangles / 2) as f64).sqrt() as usize;
    let vertex = |i: usize| {
        let (x, y) = ((i % (side + 1)) as f64 / side as f64, (i / (side + 1)) as f64 / side as f64);
        [24.0 * x, 18.0 * y, 0.3 * ((9.0 * x).sin() + (7.0 * y).cos())]
    };
    let vertices = (0..(side + 1) * (side + 1)).map(vertex).collect();
    let quad = |i: usize| {
        let a = (i / side * (side + 1) + i % side) as u32;
        let b = a + side as u32 + 1;
        [[a, a + 1, b], [a + 1, b + 1, b]]
    };
    let triangles = (0..side * side).flat_map(quad).collect();
    match Mesh::new(vertices, triangles) {
        Ok((mesh, _)) => Clusters::new(&mesh),
        Err(error) => panic!("{error}"),
    }
}

fn capture(c: &mut Criterion) {
    let mut group = c.benchmark_group("capture");
    let turned = [[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]];
    for (name, triangles) in [("2k", 2_000), ("100k", 100_000), ("1M", 1_000_000), ("4M", 4_000_000)] {
        let object = plate(triangles);
        let placement = Placement { rotation: turned, translation_mm: [-5.0, -14.0, -0.2] };
        group.bench_function(BenchmarkId::new("plate", name), |b| {
            b.iter(|| depth::capture_mesh(black_box(&object), &placement, &CAMERA, WINDOW, 3.0));
        });
    }
    for name in ["dots", "sphere"] {
        let plan = plan(name);
        let pose = Scene::draw(&plan, 0, 0).pose.placement();
        let object = &plan.sampling.objects[0].geometry.clusters();
        group.bench_function(BenchmarkId::new("bundled", name), |b| {
            b.iter(|| depth::capture_mesh(black_box(object), &pose, &CAMERA, WINDOW, 3.0));
        });
    }
    let plan = plan("dots");
    let above = Placement { translation_mm: [0.0, 0.0, 50.0], ..Scene::draw(&plan, 0, 0).pose.placement() };
    group.bench_function(BenchmarkId::new("bundled", "out of reach"), |b| {
        b.iter(|| {
            depth::capture_mesh(black_box(&plan.sampling.objects[0].geometry.clusters()), &above, &CAMERA, WINDOW, 3.0)
        });
    });
    group.finish();
}

fn ledger() -> EffectLog {
    EffectLog::new(EffectPolicy::WhereNeeded)
}

fn stages(c: &mut Criterion) {
    let mut group = c.benchmark_group("stage");
    let blur = Pad::MeanBlur(MeanBlur::default());
    for name in ["dots", "sphere", "flat_face"] {
        let plan = plan(name);
        let sample = render(&plan, 0);
        group.bench_function(BenchmarkId::new("mean_blur", name), |b| {
            b.iter(|| blur.press(black_box(&sample.impression.depth)))
        });
        group.bench_function(BenchmarkId::new("phong", name), |b| {
            b.iter(|| plan.simulator.shade_contact(black_box(&sample.impression.contact)));
        });
        let light = plan.simulator.shade_contact(&sample.impression.contact);
        let shot = plan.job().camera.background_params();
        group.bench_function(BenchmarkId::new("expose", name), |b| {
            b.iter(|| {
                plan.simulator.camera().expose(
                    black_box(light.clone()).into(),
                    Some(&sample.impression.contact.mask),
                    None,
                    &shot,
                    &mut ledger(),
                )
            });
        });
        group.bench_function(BenchmarkId::new("render", name), |b| b.iter(|| render(black_box(&plan), 0)));
        group.bench_function(BenchmarkId::new("png", name), |b| {
            b.iter(|| png::encode_rgb(640, 480, black_box(&sample.impression.image.rgb)));
        });
        let rgb = &sample.impression.image.rgb;
        let [own, other] = [png::encode_rgb(640, 480, rgb), png_by_crate(rgb)].map(|bytes| bytes.len());
        println!("png/{name}: {own} bytes, {other} by the crate `png`: {:.2}", own as f64 / other as f64);
        group.bench_function(BenchmarkId::new("png_by_crate", name), |b| b.iter(|| png_by_crate(black_box(rgb))));
        let depth = sample.impression.depth.below_pad();
        let zip = exr::encode(640, 480, &[("Z", &depth.data)], Exr::default()).len();
        let other = exr_by_crate(&depth.data).len();
        println!("exr/{name}: {zip} bytes, {other} by the crate `exr`: {:.2}", zip as f64 / other as f64);
        group.bench_function(BenchmarkId::new("exr_by_crate", name), |b| {
            b.iter(|| exr_by_crate(black_box(&depth.data)));
        });
        for (pixel, compression) in
            [(Pixel::Half, Compression::Zip), (Pixel::Half, Compression::Rle), (Pixel::Float, Compression::Zip)]
        {
            let storage = Exr { pixel, compression };
            let id = BenchmarkId::new(format!("exr_{pixel:?}_{compression:?}").to_lowercase(), name);
            group.bench_function(id, |b| b.iter(|| exr::encode(640, 480, &[("Z", black_box(&depth.data))], storage)));
        }
        group.bench_function(BenchmarkId::new("sample_with_files", name), |b| {
            b.iter(|| {
                let sample = render(black_box(&plan), 0);
                encode::encode_members(&plan, &sample)
            });
        });
    }
    group.finish();
}

/// Light as a calibration gives it, with as many units as one has; the weights are drawn.
fn measured() -> CalibrationTable {
    let mut random = random_stream(1, "calibration", 0);
    let mut weight = || (0.2 * random.standard_normal()) as f32;
    let hidden: Vec<_> = (0..36).map(|_| std::array::from_fn(|_| weight())).collect();
    let outputs = (0..OUTPUTS).map(|_| (0..hidden.len() + INPUTS + 1).map(|_| weight()).collect()).collect();
    let response =
        CalibrationResponse { height_mm: 0.7, place_mm: 10.0, heights_mm: [-0.1, 0.7], steepest: 0.7, hidden, outputs };
    calibrate::build_table(response, Geometry { thickness_mm: 3.0, contact_over_disc: 0.95 })
}

/// Measured light of a ball, and of a surface that is bent everywhere, beside Phong's. Aim: 3 ms at the spacing
/// that the rungs have.
fn light(c: &mut Criterion) {
    let mut group = c.benchmark_group("light");
    let (plan, table) = (plan("sphere"), measured());
    let ball = render(&plan, 0).impression.contact;
    let mut waves = ball.clone();
    let width = waves.surface.width;
    for (k, w) in waves.surface.data.iter_mut().enumerate() {
        let [x, y] = [k % width, k / width].map(|at| at as f32 * 0.03125);
        *w = 0.3 + 0.1 * ((5.0 * x).sin() + (4.0 * y).cos());
    }
    waves.region = Rect::whole(width, waves.surface.height);
    for (name, contact) in [("ball", &ball), ("bent everywhere", &waves)] {
        group.bench_function(BenchmarkId::new("phong", name), |b| {
            b.iter(|| plan.simulator.shade_contact(black_box(contact)));
        });
        for spacing_mm in [Calibrated::default().spacing_mm, 0.125, 0.0625] {
            let shader = CalibratedShader::new(Calibrated { spacing_mm }, Some(&table), &CAMERA);
            let id = BenchmarkId::new(format!("calibrated_{spacing_mm}_mm"), name);
            group.bench_function(id, |b| {
                b.iter(|| shader.shade(black_box(contact), plan.simulator.background(), &mut ledger()));
            });
        }
    }
    group.finish();
}

/// What `gelsim render --stream` does with a frame of 320x240 px, from the bytes that it reads to those that it writes. The
/// floor is what it would do without any simulation: the frame taken to heights, and an image of its size written.
fn frames(c: &mut Criterion) {
    let mut group = c.benchmark_group("streamed_frame");
    let resolution_px = [320, 240];
    let overrides = Overrides::default();
    let wanted = FrameSettings {
        sensor: "gelsight-2014",
        resolution_px,
        layers: &[],
        classes: &[],
        moved: false,
        sequence: false,
        overrides: &overrides,
    };
    let plan = wanted.resolve_plan().unwrap_or_else(|report| panic!("{report}"));
    let camera = DepthCamera {
        unit: DepthUnit::Millimetre,
        plane_mm: 10.0,
        max_depth_mm: None,
        background: None,
        flip: [false; 2],
        offset_px: [0.0; 2],
        projection: DepthProjection::Orthographic,
        along: DistanceAlong::Axis,
    };
    let reader =
        FrameReader::new(camera, &plan.simulator, resolution_px).unwrap_or_else(|problem| panic!("{problem:?}"));
    let seen = |bytes: &[u8]| {
        let frame = read::decode_frame(bytes).unwrap_or_else(|reason| panic!("{reason}"));
        reader.read(frame).unwrap_or_else(|problem| panic!("{problem:?}"))
    };
    for name in ["dots", "sphere", "flat_face"] {
        let pressed = self::plan(name);
        let scene = Scene::draw(&pressed, 0, 0);
        let captured = depth::capture_indenter(
            &scene.indenter(&pressed),
            plan.simulator.view(),
            CaptureWindow { margin_px: 0, above_mm: 50.0 },
            pressed.thickness_mm(),
        );
        let distances: Vec<f32> = captured.penetration.data.iter().map(|mm| 10.0 - mm).collect();
        let bytes = npy::encode(320, 240, &[&distances]);
        group.bench_function(BenchmarkId::new("whole", name), |b| {
            b.iter(|| {
                let image = render_frame_sample(&plan, 0, "frame", seen(black_box(&bytes)), None).impression.image;
                npy::encode_rgb(image.width, image.height, &image.rgb)
            });
        });
        if name == "sphere" {
            let image = render_frame_sample(&plan, 0, "frame", seen(&bytes), None).impression.image;
            group.bench_function(BenchmarkId::new("floor", name), |b| {
                b.iter(|| {
                    let reach = seen(black_box(&bytes)).reach();
                    (reach, npy::encode_rgb(image.width, image.height, &image.rgb))
                });
            });
        }
    }
    group.finish();
}

/// Whole samples without files, as on processors with wider vectors and without.
fn vectors(c: &mut Criterion) {
    let mut group = c.benchmark_group("vectors");
    for name in ["dots", "sphere"] {
        let plan = plan(name);
        for vectors in VectorWidth::ALL {
            group.bench_function(BenchmarkId::new(format!("{vectors:?}").to_lowercase(), name), |b| {
                b.iter(|| with_width_limit(vectors, || render(black_box(&plan), 0)));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, capture, stages, light, frames, vectors);
fn main() {
    memory::keep_freed();
    benches();
    Criterion::default().configure_from_args().final_summary();
}
