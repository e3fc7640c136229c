//! The light on a pressed skin: its reflection, its shadows on itself, and its average over pixels within which it bends.

use super::Curved;
use crate::base::chart::Chart;
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::light::Light;
use crate::camera::gel_map::GelMap;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;
use crate::optics::background::BackgroundImage;
use crate::optics::coarse::Coarse;
use crate::optics::phong::Shadows;
use crate::optics::shadow::casting::Casting;
use crate::optics::skin::{PressedSkin, Skin};

/// How far, in nodes, slopes and what lies between nodes reach beyond what is displaced.
const BESIDE: usize = 2;

/// Shadows of a press on the nodes of its chart.
pub(super) struct CastShadows {
    /// For each LED where on the chart its shadow falls, and the share of the LED that is seen there; `None` if none falls.
    shares: Vec<Option<(Rect, Grid<f32>)>>,
    /// The part of the chart that any falls on.
    pub part: Rect,
}

impl Curved {
    /// The light on a pressed skin, where it differs from that of the untouched one.
    pub(super) fn lit(
        &self,
        skin: &Skin,
        picture: &BackgroundImage,
        (contact, map, shadows): (&Contact, &GelMap, Option<&CastShadows>),
        effects: &mut EffectLog,
    ) -> Light {
        let [width, height] = self.view.resolution_px;
        let displaced = contact.region.grown(BESIDE, width, height);
        let everywhere = effects.everywhere();
        let part = displaced.united(shadows.map_or_else(Rect::default, |shadows| shadows.part));
        let changed = if everywhere { Rect::whole(width, height) } else { map.around(part) };
        let need = |why| match (contact.region.is_empty(), changed.is_empty()) {
            (true, _) => Requirement::Unneeded("the skin is untouched"),
            (false, true) => Requirement::Unneeded("the camera does not see what is pressed"),
            (false, false) => Requirement::Needed(why),
        };
        let shades = effects.enable(Effect::Shading, need("the skin is pressed in"));
        let darkens = match skin.darkens() {
            true => need("the skin is pressed in"),
            false => Requirement::Absent("the optics model has no darkening"),
        };
        let darkens = effects.enable(Effect::Darkening, darkens);
        if !shades {
            effects.enable(Effect::Supersampling, need("the skin bends within pixels"));
            return Light::default();
        }
        let (skin_at, pressed) = effects.timed(Effect::Shading, || {
            let skin_at = map.skin(&contact.surface, contact.region);
            let pressed = map.pressed(&skin_at, changed);
            (skin_at, pressed)
        });
        let within = if everywhere { changed } else { map.around(displaced) };
        let bent = effects.timed(Effect::Supersampling, || map.bent(&skin_at, (changed, within), &pressed));
        let need = match bent.is_empty() {
            true => Requirement::Unneeded("the skin bends little from pixel to pixel"),
            false => Requirement::Needed("the skin bends within pixels"),
        };
        let averages = effects.enable(Effect::Supersampling, need);
        let shares = shadows.map_or(&[][..], |shadows| &shadows.shares);
        let visible: Vec<Option<Vec<f32>>> = effects.timed(Effect::Shadows, || {
            let in_image = |(there, shares): &(Rect, Grid<f32>)| map.layer_of_part(shares, *there, changed, 1.0);
            shares.iter().map(|shares| shares.as_ref().map(in_image)).collect()
        });
        let pressed = PressedSkin {
            region: changed,
            normals: pressed.normals.each_ref().map(|plane| &plane[..]),
            displaced_mm: &pressed.down_mm,
            visible: &visible,
            bent: if averages { &bent } else { &[] },
        };
        effects.timed(Effect::Shading, || skin.shade(&pressed, picture, darkens))
    }

    /// The shadows that a press casts on its chart, if any does.
    pub(super) fn cast_shadows(
        &self,
        skin: &Skin,
        contact: &Contact,
        chart: &Chart,
        effects: &mut EffectLog,
    ) -> Option<CastShadows> {
        let everywhere = effects.everywhere();
        let casting = effects.timed(Effect::Shadows, || self.casting(skin, contact, chart, everywhere));
        let need = match skin.shadows() {
            Shadows::None => Requirement::Absent("the optics model has no shadows"),
            Shadows::Soft(_) if contact.region.is_empty() => Requirement::Unneeded("the skin is untouched"),
            Shadows::Soft(_) if casting.is_none() => Requirement::Unneeded("no slope rises above an LED"),
            Shadows::Soft(_) => Requirement::Needed("a slope rises above an LED"),
        };
        let casting = if effects.enable(Effect::Shadows, need) { casting? } else { return None };
        Some(effects.timed(Effect::Shadows, || self.shares(&casting, contact, everywhere)))
    }

    /// What casts shadows on a chart, if anything does. The gel itself, which bulges away from all light inside it, casts none.
    fn casting(&self, skin: &Skin, contact: &Contact, chart: &Chart, everywhere: bool) -> Option<Casting> {
        let Shadows::Soft(soft) = skin.shadows() else { return None };
        if contact.region.is_empty() && !everywhere {
            return None;
        }
        // What touches, and not what is displaced: that ends where the chart does, which goes on in steps.
        let touches = bounding_box(&contact.mask, |touches| touches > 0);
        let middle = [touches.x0 + touches.x1, touches.y0 + touches.y1].map(|ends| 0.5 * ends as f64);
        let rest = chart.rest(self.view.point_mm(middle));
        let lights = |pitch: [f64; 2], _| skin.casters(&rest, pitch);
        Casting::new(Coarse::new(soft.resolution), &contact.surface, &self.view, everywhere, lights)
    }

    /// The share of each LED that is seen where its shadow falls on the chart.
    fn shares(&self, casting: &Casting, contact: &Contact, everywhere: bool) -> CastShadows {
        let [width, height] = self.view.resolution_px;
        let reach = match everywhere {
            true => Rect::whole(width, height),
            false => casting.reach(contact.region.grown(BESIDE, width, height), &self.view),
        };
        let mut line = Vec::new();
        let mut all = Grid { width: reach.width(), height: reach.height(), data: vec![1.0; reach.area()] };
        let mut part = Rect::default();
        let shares = casting.shares(&self.view, reach).into_iter().map(|values| {
            let values = values?;
            for y in 0..all.height {
                values.row(reach.y0 + y, reach.x0, &mut line, all.row_mut(y));
            }
            // With a border where all is seen, between which and what lies beyond nothing changes.
            let shadow = bounding_box(&all, |share| share < 1.0).grown(1, all.width, all.height);
            if shadow.is_empty() {
                return None;
            }
            let there = Rect {
                x0: shadow.x0 + reach.x0,
                y0: shadow.y0 + reach.y0,
                x1: shadow.x1 + reach.x0,
                y1: shadow.y1 + reach.y0,
            };
            part = part.united(there);
            Some((there, all.crop(shadow)))
        });
        CastShadows { shares: shares.collect(), part }
    }
}
