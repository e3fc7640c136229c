//! What people write for keys and values of a job who have not read the docs, and what they mean.

/// What is meant by an unknown key.
pub enum Meaning {
    /// This key of the same table.
    Key(&'static str),
    /// Something that is said elsewhere; holds the advice.
    Elsewhere(&'static str),
}

use Meaning::{Elsewhere, Key};

/// Unknown keys, in lower case with `_` between words, and what they mean: the first meaning that fits the table
/// counts.
pub const KEY_GUESSES: &[(&[&str], &[Meaning])] = &[
    (
        &["background_image", "background_path", "background_file", "bg", "bg_image", "reference_image"],
        &[Key("background"), Elsewhere("under [sensor]: background = \"untouched.png\"")],
    ),
    (
        &["leds", "lights", "light", "lighting", "led_list", "illumination"],
        &[
            Elsewhere(
                "each LED is a table of its own, [[sensor.led]], in a sensor file [[led]], with azimuth_deg, elevation_deg and color",
            ),
            Key("led"),
        ],
    ),
    (
        &["variation", "randomize", "randomise", "randomization", "randomisation", "domain_randomization", "jitter"],
        &[
            Key("variation"),
            Elsewhere(
                "[sensor.unit] variation = 0.5 draws another unit of the sensor for each sample; other quantities take [min, max]",
            ),
        ],
    ),
    (
        &["dir", "out", "out_dir", "output_dir", "output_path", "folder", "root", "save_dir", "destination"],
        &[Key("path"), Elsewhere("--out DIR on the command line says where a dataset goes")],
    ),
    (
        &["type", "model", "kind", "sensor", "sensor_type", "sensor_name", "sensor_model"],
        &[Key("preset"), Elsewhere("under [sensor]: preset = \"digit\"")],
    ),
    (
        &[
            "mesh",
            "mesh_path",
            "mesh_file",
            "file_path",
            "filename",
            "file_name",
            "file",
            "obj",
            "stl",
            "source",
            "uri",
            "url",
            "meshes",
        ],
        &[Key("path"), Elsewhere("under [[object]]: path = \"my-part.stl\"")],
    ),
    (
        &["noise", "noise_level", "noise_std", "sensor_noise", "image_noise", "gaussian_noise"],
        &[Key("read_noise_levels"), Elsewhere("under [camera]: read_noise_levels = 2.0, in grey levels")],
    ),
    (
        &["yaw", "rz_deg", "rz", "rotation", "rotation_deg", "angle", "angle_deg", "theta", "orientation"],
        &[Key("yaw_deg"), Elsewhere("under [pose]: yaw_deg = 90.0 about the pad's normal, and face = \"-z\"")],
    ),
    (
        &["gel", "pad", "elastomer", "skin", "material", "gelpad_params"],
        &[Elsewhere(
            "under [sensor]: gelpad_thickness_mm and gelpad_youngs_modulus_kpa; of a soft object youngs_modulus_kpa under [[object]]",
        )],
    ),
    (&["rx_deg", "rx", "roll"], &[Key("roll_deg")]),
    (&["ry_deg", "ry", "pitch"], &[Key("pitch_deg"), Key("pitch_mm")]),
    (&["tilt"], &[Key("tilt_deg")]),
    (
        &["x", "dx", "x_offset", "x_offset_mm", "tx", "pos_x"],
        &[Key("x_mm"), Elsewhere("under [pose]: x_mm = [-2.0, 2.0]")],
    ),
    (
        &["y", "dy", "y_offset", "y_offset_mm", "ty", "pos_y"],
        &[Key("y_mm"), Elsewhere("under [pose]: y_mm = [-2.0, 2.0]")],
    ),
    (
        &[
            "z",
            "z_mm",
            "dz",
            "tz",
            "depth",
            "indentation_depth",
            "indentation_depth_mm",
            "penetration",
            "penetration_mm",
            "press_depth",
            "indentation_mm",
        ],
        &[Key("depth_mm"), Elsewhere("under [indentation]: depth_mm = [0.2, 1.0], from the undeformed pad")],
    ),
    (
        &["force", "force_n", "normal_force", "force_newton"],
        &[
            Key("force_n"),
            Elsewhere("under [indentation]: force_n = 1.0; phases of a sequence and [gripper] have it, too"),
        ],
    ),
    (
        &["n", "num", "count", "number", "num_samples", "n_samples", "number_of_samples", "images", "num_images"],
        &[Key("samples"), Elsewhere("under [dataset]: samples = 1000")],
    ),
    (&["size", "length"], &[Key("length_mm"), Key("resolution_px"), Key("samples")]),
    (&["random_seed", "rng_seed", "rng", "random_state"], &[Key("seed"), Elsewhere("under [dataset]: seed = 7")]),
    (&["shard_size", "samples_per_tar", "shards", "maxcount"], &[Key("samples_per_shard")]),
    (
        &["split", "split_ratio", "train_split", "train_val_test", "train_fraction", "ratios"],
        &[Key("splits"), Key("split"), Elsewhere("under [dataset]: splits = { train = 0.9, test = 0.1 }")],
    ),
    (
        &[
            "resolution",
            "image_size",
            "img_size",
            "width",
            "height",
            "shape_px",
            "size_px",
            "res",
            "image_resolution",
            "camera_resolution",
            "sensor_resolution",
            "width_px",
            "height_px",
        ],
        &[Key("resolution_px"), Elsewhere("under [sensor]: resolution_px = [320, 240]")],
    ),
    (
        &["fov", "field_of_view", "fov_mm", "view_mm", "sensor_size", "sensor_size_mm", "size_mm", "area_mm"],
        &[Key("field_of_view_mm"), Key("length_mm")],
    ),
    (
        &["mm_per_pixel", "pixmm", "pixel_size", "pixel_size_mm", "px_size", "mm_px"],
        &[
            Key("mm_per_px"),
            Elsewhere("pixels have the size field_of_view_mm / resolution_px: field_of_view_mm = [width, height]"),
        ],
    ),
    (
        &["thickness", "thickness_mm", "gel_thickness", "gelpad_thickness", "gel_thickness_mm", "elastomer_thickness"],
        &[Key("gelpad_thickness_mm")],
    ),
    (
        &[
            "youngs_modulus",
            "young_modulus",
            "elastic_modulus",
            "stiffness",
            "stiffness_kpa",
            "modulus",
            "e",
            "youngs_modulus_pa",
            "youngs_modulus_kpa",
        ],
        &[Key("youngs_modulus_kpa"), Key("gelpad_youngs_modulus_kpa")],
    ),
    (
        &[
            "viscosity",
            "viscoelastic",
            "viscoelasticity",
            "prony",
            "creep",
            "relaxation_time_s",
            "relaxations",
            "relaxation",
        ],
        &[
            Key("gelpad_relaxation"),
            Elsewhere("under [gelpad]: relaxation = [{ share = 0.2, time_s = 0.5 }]; in sequences"),
        ],
    ),
    (&["poisson", "nu", "poissons_ratio", "poisson_ratio"], &[Key("poisson_ratio"), Key("gelpad_poisson_ratio")]),
    (&["mu", "friction_coefficient", "coefficient_of_friction"], &[Key("friction"), Key("coefficient")]),
    (&["unit_scale", "units", "mesh_unit"], &[Key("unit")]),
    (&["size_scale", "scaling", "scale_factor", "mesh_scale"], &[Key("scale")]),
    (
        &["longest_side", "longest_side_mm", "target_size", "target_size_mm", "normalize", "normalise"],
        &[Key("length_mm")],
    ),
    (&["label", "category", "class_name", "object_class"], &[Key("class")]),
    (&["probability", "prob", "p", "frequency"], &[Key("weight")]),
    (
        &["outputs", "channels", "maps", "annotations", "modalities"],
        &[Key("layers"), Elsewhere("under [output]: layers = [\"depth\"]")],
    ),
    (&["format", "file_format", "output_format", "writer", "storage"], &[Key("container"), Key("depth_format")]),
    (&["compress", "exr_compression"], &[Key("compression"), Key("exr")]),
    (&["colour", "rgb"], &[Key("color")]),
    (&["azimuth", "phi"], &[Key("azimuth_deg")]),
    (&["elevation", "altitude"], &[Key("elevation_deg")]),
    (&["brightness", "power", "strength"], &[Key("intensity"), Key("exposure")]),
    (&["lower", "low", "minimum", "from", "a"], &[Key("min")]),
    (&["upper", "high", "maximum", "to", "b"], &[Key("max")]),
    (&["mu_mm", "average", "loc"], &[Key("mean")]),
    (&["sd", "sigma", "stddev", "std_dev"], &[Key("std")]),
    (&["spacing", "spacing_mm", "distance_mm", "pitch"], &[Key("pitch_mm")]),
    (&["radius_mm", "dot_size", "dot_size_mm", "diameter"], &[Key("diameter_mm")]),
    (&["fps", "frame_rate", "framerate", "hz", "rate_hz"], &[Key("frame_rate_hz")]),
    (&["phases", "steps", "motion", "trajectory"], &[Key("phase")]),
    (&["duration", "time_s", "seconds"], &[Key("duration_s")]),
    (&["level", "quality", "rung"], &[Key("fidelity"), Elsewhere("at the top of the job: fidelity = \"standard\"")]),
    (&["objects", "object_list", "indenter", "indenters"], &[Key("object")]),
    (&["side", "facing"], &[Key("face"), Elsewhere("under [pose]: face = \"-z\"")]),
    (&["workers", "num_workers", "threads", "n_jobs", "jobs"], &[Elsewhere("--threads T on the command line")]),
    (&["overwrite", "force_overwrite"], &[Elsewhere("--overwrite on the command line")]),
];

/// Unknown values of keys that take a choice, and what they mean: the first one that the key takes counts.
pub const CHOICE_GUESSES: &[(&[&str], &[&str])] = &[
    (&["heightmap", "height_map", "height", "deformation", "displacement"], &["surface"]),
    (&["mask", "contact_mask", "segmentation", "contact_area"], &["contact", "instance"]),
    (&["force", "pressures", "normal_force"], &["pressure"]),
    (&["forces", "force_map", "force_field", "stress"], &["traction"]),
    (&["tractions", "shear_force", "shear_stress", "tangential_force", "friction_force"], &["traction"]),
    (&["normals", "gradient", "gradients", "normal_map"], &["normal"]),
    (&["point_cloud", "pointcloud", "xyz"], &["points"]),
    (&["shear", "optical_flow", "motion"], &["flow"]),
    (&["marker", "dots", "marker_motion"], &["markers"]),
    (&["background", "no_contact", "ref"], &["reference"]),
    (&["depth_map", "depthmap", "indentation"], &["depth"]),
    (&["meters", "metres", "meter", "metre"], &["m"]),
    (&["millimeters", "millimetres", "millimeter", "millimetre"], &["mm"]),
    (&["centimeters", "centimetres", "centimeter", "centimetre"], &["cm"]),
    (&["inch", "inches", "\""], &["in"]),
    (&["random", "all", "every"], &["any"]),
    (&["best", "automatic", "relief"], &["auto"]),
    (&["down", "bottom", "lowest"], &["-z", "contact"]),
    (&["up", "top"], &["+z"]),
    (&["center", "centre", "bbox", "bounding_box", "com"], &["bounds"]),
    (&["webdataset", "wds", "shards"], &["tar"]),
    (&["imagefolder", "folders", "directory", "files", "png"], &["folder"]),
    (&["fast", "low", "quick", "preview"], &["draft"]),
    (&["medium", "normal", "default", "balanced"], &["standard"]),
    (&["accurate", "fine", "best"], &["high"]),
    (&["exact", "max", "ultra"], &["reference"]),
    (&["finitestrain", "nonlinear", "neo_hookean", "hyperelastic"], &["finite-strain", "finite_strain"]),
    (&["fem", "soft", "mechanical"], &["elastic"]),
    (&["lookup", "lut", "table", "taxim", "polynomial", "measured", "calibration"], &["calibrated"]),
    (&["skip", "ignore", "drop"], &["skip", "reject"]),
    (&["error", "raise", "stop", "abort"], &["error", "fail"]),
    (&["mini", "gelsight_mini", "gelsightmini", "gs_mini", "r1.5", "gelsight", "gelsight_r15"], &["gelsight-mini"]),
    (&["digit360", "digit_360", "omnitact"], &["digit"]),
    (&["gelsight_2014", "gelsight2014"], &["gelsight-2014"]),
    (&["gelsight_2017", "gelsight2017", "wedge", "gelsight_wedge", "gelslim", "r1"], &["gelsight-2017"]),
];

/// Values that belong somewhere else altogether, or nowhere, and what to write instead. They mean nothing that is
/// spelt like them.
pub const CHOICE_HELP: &[(&[&str], &str)] = &[
    (
        &["um", "\u{b5}m", "\u{3bc}m", "micrometers", "micrometres", "micrometer", "micrometre", "micron", "microns"],
        "for micrometres write unit = \"mm\" and scale = 0.001",
    ),
    (
        &["hdf5", "h5", "zarr", "lerobot", "parquet", "rlds", "tfrecord"],
        "gelsim-export copies a dataset to lerobot, zarr or hdf5 (pip install '.[export]', docs/how-to/export.md)",
    ),
    (
        &["rgb", "image", "tactile", "color", "colour", "images"],
        "the tactile image is always written; `layers` are what is beside it",
    ),
    (
        &["label", "labels", "pose", "class", "json"],
        "the label, with pose, class and force, is always written as JSON; `layers` are images",
    ),
];
