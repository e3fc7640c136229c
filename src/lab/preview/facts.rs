//! What of a label a person wants to read while a job is tuned: names and values in words.

use gelsim_dataset::labels::SampleLabel;
use gelsim_files::number_format::{format_number, format_percent};
use gelsim_job::gripper::label::GripperLabel;
use gelsim_job::label::{ContactLabel, Label, MarkersLabel, NumericsLabel, ObjectLabel, PoseLabel, ShearLabel};
use serde::Serialize;

/// A line of a label in words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Fact {
    /// What it is, or what the lines below it are about.
    name: String,
    /// Its value, with the unit; empty for a heading.
    value: String,
}

/// An effect of a sample.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct EffectFact {
    name: &'static str,
    ran: bool,
    reason: String,
}

/// Describes a label in words. Of a sequence it is the frame with the largest contact.
pub fn list_facts(label: &SampleLabel) -> Vec<Fact> {
    let summary = label.summary();
    let mut facts = Facts::default();
    facts.add_object(summary);
    match label {
        SampleLabel::Press(_) => {}
        SampleLabel::Grip(grip, _) => facts.add_grip(&grip.gripper),
        SampleLabel::Sequence(sequence, _) => {
            let course = &sequence.common.sequence;
            facts.add_frames(course.frames, course.frame_rate_hz, course.phases.iter().map(|phase| &*phase.name));
            facts.add_slip(course.friction_coefficient, course.first_slip_s, course.gross_slip_s);
        }
        SampleLabel::GripSequence(sequence, _) => {
            let course = &sequence.sequence;
            facts.add_frames(course.frames, course.frame_rate_hz, course.phases.iter().map(|phase| &*phase.name));
            facts.add_slip(course.friction_coefficient, course.first_slip_s, course.gross_slip_s);
        }
    }
    if let SampleLabel::Grip(grip, _) = label {
        facts.add_rest(summary);
        for (finger, felt) in grip.fingers() {
            facts.add(&format!("{finger} finger"), "");
            facts.add_pose(&felt.pose, felt.indentation_depth_mm);
            facts.add_contact(&felt.contact, 0.0);
            facts.add_motion(&felt.shear, &felt.markers);
            facts.add_numerics(&felt.numerics);
        }
        return facts.0;
    }
    if label.frames().is_some() {
        facts.add_rest(summary);
        facts.add("frame of the largest contact", "");
    }
    facts.add_pose(&summary.pose, summary.indentation_depth_mm);
    facts.add_contact(&summary.contact, summary.wanted_force_n);
    facts.add_motion(&summary.shear, &summary.markers);
    facts.add_numerics(&summary.numerics);
    if label.frames().is_none() {
        facts.add_rest(summary);
    }
    facts.0
}

/// Lists the effects of a sample, those that ran first.
pub fn list_effects(label: &SampleLabel) -> Vec<EffectFact> {
    let effects = label.summary().effects.iter();
    let mut effects: Vec<EffectFact> = effects
        .map(|(effect, note)| EffectFact { name: effect.name(), ran: note.ran, reason: note.reason.to_string() })
        .collect();
    effects.sort_by_key(|effect| !effect.ran);
    effects
}

#[derive(Default)]
struct Facts(Vec<Fact>);

impl Facts {
    fn add(&mut self, name: &str, value: impl Into<String>) {
        self.0.push(Fact { name: name.to_owned(), value: value.into() });
    }

    fn add_object(&mut self, label: &Label) {
        let ObjectLabel { id, class, scale, material, .. } = &label.header.object;
        self.add("class", class);
        if id != class {
            self.add("object", id);
        }
        if *scale != 1.0 {
            self.add("scale", format_number(*scale));
        }
        if label.objects.len() > 1 {
            let others = label.objects[1..].iter().map(|other| other.class.as_str()).collect::<Vec<_>>();
            self.add("with it", others.join(", "));
        }
        if label.unplaced_objects > 0 {
            self.add("found no place", label.unplaced_objects.to_string());
        }
        if let Some(modulus) = material.youngs_modulus_kpa {
            self.add("Young's modulus", format!("{} kPa", format_number(modulus)));
        }
    }

    fn add_pose(&mut self, pose: &PoseLabel, depth_mm: f64) {
        self.add("depth", format!("{} mm", format_number(depth_mm)));
        let tilt = match pose.tilt_deg {
            0.0 => String::new(),
            tilt => format!(", tilt {}° about {}°", format_number(tilt), format_number(pose.tilt_azimuth_deg)),
        };
        self.add("pose", format!("yaw {}°{tilt}", format_number(pose.yaw_deg)));
        self.add("position", format!("{} mm", join_numbers(&pose.translation_mm)));
    }

    fn add_contact(&mut self, contact: &ContactLabel, wanted_n: f64) {
        if !contact.in_contact {
            return self.add("contact", "none");
        }
        let cut = if contact.cut_by_view { ", cut by the view" } else { "" };
        let (area, share) = (format_number(contact.area_mm2), format_percent(contact.fraction));
        self.add("contact", format!("{area} mm², {share} of the view{cut}"));
        let wanted = if wanted_n > 0.0 { format!(", wanted {} N", format_number(wanted_n)) } else { String::new() };
        let unknown = || format!("unknown: {}", contact.force_unknown);
        let force = match (contact.force_n, contact.total_force_n) {
            (Some(view), Some(all)) if format_number(view) != format_number(all) => {
                format!("{} N, {} N of it in view", format_number(all), format_number(view))
            }
            (_, Some(all)) => format!("{} N", format_number(all)),
            (Some(view), None) => format!("{} N in view", format_number(view)),
            (None, None) => unknown(),
        };
        self.add("force", force + &wanted);
        if let Some(peak) = contact.peak_pressure_kpa {
            self.add("peak pressure", format!("{} kPa", format_number(peak)));
        }
    }

    fn add_motion(&mut self, shear: &ShearLabel, markers: &MarkersLabel) {
        if shear.shift_mm != [0.0; 2] || shear.twist_deg != 0.0 {
            let shift = join_numbers(&shear.shift_mm);
            self.add("moved", format!("{shift} mm, turned {}°", format_number(shear.twist_deg)));
            if let Some(force) = shear.force_n {
                self.add("shear force", format!("{} N", join_numbers(&force)));
            }
            if let Some(slipping) = shear.slipping {
                self.add("slips", format!("{} of the contact", format_percent(slipping)));
            }
        }
        if markers.count > 0 {
            let (mean, most) = (format_number(markers.mean_motion_px), format_number(markers.max_motion_px));
            self.add("markers", format!("{}, moved by {mean} px, {most} px at most", markers.count));
        }
    }

    fn add_numerics(&mut self, numerics: &NumericsLabel) {
        let beyond = if numerics.beyond_theory { ", beyond linear theory" } else { "" };
        self.add("strain", format!("{}{beyond}", format_number(numerics.strain)));
        self.add("model error", known(numerics.model_error_um, "um", &numerics.model_error_unknown));
        let light = known(numerics.light_error_levels, "grey levels", &numerics.light_error_unknown);
        self.add("light error", light);
        if !numerics.converged {
            self.add("contact", "not solved to its tolerance");
        }
    }

    fn add_grip(&mut self, grip: &GripperLabel) {
        let (width, object) = (format_number(grip.width_mm), format_number(grip.object_width_mm));
        self.add("gripper", format!("{width} mm wide, object {object} mm"));
        if let Some(force) = grip.force_n {
            let held = if grip.balanced { "" } else { ", not balanced" };
            self.add("grip", format!("{} N{held}", format_number(force)));
        }
    }

    fn add_frames<'a>(&mut self, count: u32, rate_hz: f64, phases: impl Iterator<Item = &'a str>) {
        let phases = phases.collect::<Vec<_>>().join(", ");
        self.add("frames", format!("{count} at {} Hz: {phases}", format_number(rate_hz)));
    }

    fn add_slip(&mut self, friction: Option<f64>, first_s: Option<f64>, gross_s: Option<f64>) {
        let friction = friction.map_or(String::new(), |friction| format!(" (friction {})", format_number(friction)));
        let slip = match (first_s, gross_s) {
            (None, _) => String::from("none"),
            (Some(first), None) => format!("begins at {} s, part of the contact holds", format_number(first)),
            (Some(first), Some(gross)) => {
                format!("begins at {} s, of all the contact at {} s", format_number(first), format_number(gross))
            }
        };
        self.add("slip", slip + &friction);
    }

    fn add_rest(&mut self, label: &Label) {
        let texture = &label.texture;
        if !texture.pattern.is_empty() {
            let (deep, wide) = (format_number(texture.amplitude_mm), format_number(texture.scale_mm));
            self.add("texture", format!("{}, {deep} mm deep, {wide} mm wide", texture.pattern));
        }
        self.add("sensor", &label.sensor.name);
        let models = &label.models;
        self.add("fidelity", format!("{} ({}, {})", models.fidelity, models.gelpad_model, models.optics_model));
        if label.header.attempt > 0 {
            self.add("drawn again", format!("{} draws before it were rejected", label.header.attempt));
        }
        let health = &label.health;
        self.add("health", if health.healthy { "healthy" } else { &health.reason });
    }
}

fn known(value: Option<f64>, unit: &str, unknown: &str) -> String {
    value.map_or_else(|| format!("unknown: {unknown}"), |value| format!("{} {unit}", format_number(value)))
}

fn join_numbers(values: &[f64]) -> String {
    values.iter().map(|value| format_number(*value)).collect::<Vec<_>>().join(", ")
}
