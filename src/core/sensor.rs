//! A sensor as the simulator knows it: numbers and images, and what makes them impossible to simulate.

use std::sync::Arc;

use crate::base::gel::GelShape;
use crate::base::view::{MOST_PX, View};
use crate::camera::CameraParams;
use crate::camera::markers::{MarkerPattern, MarkerPrint};
use crate::camera::pins::Pins;
use crate::camera::projection::{LensModel, Projection};
use crate::depth::rest_surface::{Grain, RestSurface};
use crate::gelpad::elastic::relaxation::RelaxationMode;
use crate::gelpad::material::Material;
use crate::optics::background::{BackgroundImage, RenderedBackground};
use crate::optics::calibrated::CalibrationTable;
use crate::optics::lamps::{self, Lamp};
use crate::optics::led::Led;
use crate::optics::light_pattern;
use crate::optics::near_light::bounce::Coat;
use crate::optics::near_light::window::Window;
use crate::optics::residual::{self, LightResidual};
use crate::optics::{Illumination, LightSource};

/// A camera-based tactile sensor.
///
/// Every field is public and may be changed; [`Simulator::new`](crate::simulator::Simulator::new) checks all of them.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Sensor {
    /// Name that is written to labels.
    pub name: String,
    /// Width and height of the image, px, 1 to 8192.
    pub resolution_px: [usize; 2],
    /// Width and height of the pad's window that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// The gelpad.
    pub gelpad: Material,
    /// How the gelpad relaxes in sequences; empty if it does not.
    pub relaxation: Vec<RelaxationMode>,
    /// Shape of a gel that a camera inside it sees through [`Sensor::lens`]. `None`: the pad is flat, or nearly.
    pub shape: Option<GelShape>,
    /// Lens and position of that camera; used with a [`shape`](Sensor::shape) only.
    pub lens: LensModel,
    /// Pins inside the gel; they need a [`shape`](Sensor::shape).
    pub pins: Option<Pins>,
    /// Height of a pad that is nearly flat; `None` if it is flat.
    pub rest_surface: Option<RestSurface>,
    /// Relief of the pad's coating; `None` if it is smooth.
    pub coating: Option<Grain>,
    /// The image without contact.
    pub background: Background,
    /// The LEDs, for the optics models `phong` and `led`.
    pub leds: Vec<Led>,
    /// The lamps, for the optics model `lamps`: none, or six.
    pub lamps: Vec<Lamp>,
    /// Fraction of the light that is lost where the pad is pressed down to the shell, 0 to 1. An optics model may set
    /// another.
    pub darkening: f64,
    /// Light of the background image that is not the LEDs', 0 to 1 in each channel: what the LEDs add is scaled by the
    /// rest of that image. `None`: it is not scaled.
    pub stray_light: Option<[f64; 3]>,
    /// Light that the LEDs leave unexplained, for the optics models `phong` and `led`.
    pub light_residual: Option<Arc<LightResidual>>,
    /// The window between gel and air, in which near LEDs are mirrored; `None`: nothing is mirrored.
    pub window: Option<Window>,
    /// How the coat reflects; used by the optics model `led`.
    pub coat: Coat,
    /// Calibrated optics, for the optics model `calibrated`.
    pub calibration: Option<Arc<CalibrationTable>>,
    /// Dots printed on the pad; `None` if there are none.
    pub markers: Option<Markers>,
    /// The camera's parameters.
    pub camera: CameraParams,
}

/// The image without contact.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Background {
    /// Rendered from the LEDs; on a sensor with lamps, from the lamps alone.
    Rendered(RenderedBackground),
    /// A photograph by the sensor's own camera, in the sensor's resolution.
    Photograph(Arc<BackgroundImage>),
}

impl Background {
    /// Returns the size of the grain of a rendered background, mm; `None` for a photograph.
    pub(crate) fn grain_size_mm(&self) -> Option<f64> {
        match self {
            Self::Rendered(look) => Some(look.grain_size_mm),
            Self::Photograph(_) => None,
        }
    }
}

/// Dots printed on the pad.
#[derive(Clone, Debug, PartialEq)]
pub struct Markers {
    /// Their ink, edge and arrangement.
    pub print: MarkerPrint,
    /// Their distance, size and jitter; `None` if each press has its own.
    pub pattern: Option<MarkerPattern>,
}

/// The reason why a sensor cannot be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SensorError {
    /// The image has no pixel, or too many.
    #[error("resolution_px is {0:?}; allowed: 1 to {MOST_PX} on a side")]
    Resolution([usize; 2]),
    /// A number is out of range.
    #[error("{name} is {value}; it must be {allowed}")]
    Number {
        /// The field's name.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The values that are allowed.
        allowed: &'static str,
    },
    /// The relaxation of the gelpad is impossible.
    #[error("relaxation: {0}")]
    Relaxation(String),
    /// A polynomial has a number of coefficients that none can have.
    #[error("the {name} has {found} coefficients for a channel; allowed: {allowed:?}")]
    Coefficients {
        /// What it is.
        name: &'static str,
        /// How many there are.
        found: usize,
        /// How many there may be.
        allowed: &'static [usize],
    },
    /// It has lamps, but not as many as the optics model `lamps` takes.
    #[error("the sensor has {0} lamps; a sensor has none or {count}", count = lamps::LAMP_COUNT)]
    Lamps(usize),
    /// It has pins, but its gel is flat.
    #[error("a sensor with pins needs the shape of its gel")]
    Pins,
    /// The fidelity level solves finite strain, which is for flat pads, and the gel of this sensor has a shape.
    #[error(
        "the fidelity level finite-strain is for flat pads, and this sensor's gel has a shape: take the level high"
    )]
    FiniteStrainOnCurvedGel,
    /// The camera sees no gel.
    #[error("the camera sees no gel: move it, or turn it towards the gel")]
    NoGelInView,
    /// The photograph of the untouched pad has another size than the sensor's image.
    #[error("the background image has {found:?} px, the sensor {expected:?}")]
    BackgroundSize {
        /// Width and height of the photograph, px.
        found: [usize; 2],
        /// Width and height of the sensor's image, px.
        expected: [usize; 2],
    },
}

impl Sensor {
    /// Makes a sensor with a flat pad and an ideal camera: no LEDs, no markers, and a rendered background image. Light
    /// it by pushing LEDs onto [`Sensor::leds`].
    pub fn new(name: &str, resolution_px: [usize; 2], field_of_view_mm: [f64; 2], gelpad: Material) -> Self {
        Self {
            name: name.to_owned(),
            resolution_px,
            field_of_view_mm,
            gelpad,
            relaxation: Vec::new(),
            shape: None,
            lens: LensModel::default(),
            pins: None,
            rest_surface: None,
            coating: None,
            background: Background::Rendered(RenderedBackground::default()),
            leds: Vec::new(),
            lamps: Vec::new(),
            darkening: 0.0,
            stray_light: None,
            light_residual: None,
            window: None,
            coat: Coat::default(),
            calibration: None,
            markers: None,
            camera: CameraParams::default(),
        }
    }

    /// Changes the size of the image; the field of view stays as it is.
    pub fn with_resolution(mut self, resolution_px: [usize; 2]) -> Self {
        self.resolution_px = resolution_px;
        self
    }

    /// Returns the view: the only place that knows where a pixel lies on the pad. For a gel that is not flat, it is the
    /// view of a chart.
    pub fn view(&self) -> View {
        if let Some(shape) = &self.shape
            && let Some(view) = self.projection().chart_view(shape)
        {
            return view;
        }
        // A sensor that has not been checked yet may have no pixels.
        let mm_per_px = std::array::from_fn(|k| self.field_of_view_mm[k] / self.resolution_px[k].max(1) as f64);
        View { resolution_px: self.resolution_px, mm_per_px }
    }

    /// Returns the projection of the camera inside a gel that is not flat.
    pub fn projection(&self) -> Projection {
        Projection::new(&self.lens, self.resolution_px, self.field_of_view_mm)
    }

    /// Returns the width and height of what the view shows, mm.
    pub(crate) fn window_mm(&self) -> [f64; 2] {
        match &self.shape {
            None => self.field_of_view_mm,
            Some(_) => {
                let View { resolution_px, mm_per_px } = self.view();
                std::array::from_fn(|k| resolution_px[k] as f64 * mm_per_px[k])
            }
        }
    }

    /// Returns the background image in the sensor's resolution; renders it if there is no photograph.
    pub fn background(&self) -> Arc<BackgroundImage> {
        match &self.background {
            Background::Photograph(photograph) => Arc::clone(photograph),
            Background::Rendered(_) if !self.lamps.is_empty() => {
                Arc::new(lamps::LampShader::new(&self.lamps, &self.view()).render_background())
            }
            Background::Rendered(look) => {
                Arc::new(BackgroundImage::render(look, &self.leds, self.field_of_view_mm, &self.view()))
            }
        }
    }

    /// Returns what decides the light, besides the background image.
    pub(crate) fn illumination(&self) -> Illumination<'_> {
        Illumination {
            leds: &self.leds,
            lamps: &self.lamps,
            field_of_view_mm: self.field_of_view_mm,
            thickness_mm: self.gelpad.thickness_mm,
            is_photograph: self.has_photograph(),
            darkening: self.darkening,
            stray_light: self.stray_light,
            residual: self.light_residual.as_deref(),
            window: self.window.as_ref(),
            coat: self.coat,
        }
    }

    /// Returns what is known of the sensor's light.
    pub fn light_source(&self) -> LightSource {
        LightSource::new(self.calibration.is_some(), &self.lamps)
    }

    /// Returns true if the background image is a photograph.
    pub fn has_photograph(&self) -> bool {
        matches!(self.background, Background::Photograph(_))
    }

    /// Checks that the sensor can be simulated.
    ///
    /// # Errors
    ///
    /// The first thing that makes it impossible.
    pub fn check(&self) -> Result<(), SensorError> {
        if !self.resolution_px.iter().all(|px| (1..=MOST_PX).contains(px)) {
            return Err(SensorError::Resolution(self.resolution_px));
        }
        let positive = |name: &'static str, value: f64| match value > 0.0 && value.is_finite() {
            true => Ok(()),
            false => Err(SensorError::Number { name, value, allowed: "above 0 and finite" }),
        };
        positive("field_of_view_mm[0]", self.field_of_view_mm[0])?;
        positive("field_of_view_mm[1]", self.field_of_view_mm[1])?;
        positive("gelpad.thickness_mm", self.gelpad.thickness_mm)?;
        positive("gelpad.youngs_modulus_kpa", self.gelpad.youngs_modulus_kpa)?;
        let value = self.gelpad.poisson_ratio;
        if !(0.0..=0.4999).contains(&value) {
            return Err(SensorError::Number { name: "gelpad.poisson_ratio", value, allowed: "0 to 0.4999" });
        }
        if let Some(reason) = RelaxationMode::find_errors(&self.relaxation).into_iter().next() {
            return Err(SensorError::Relaxation(reason));
        }
        match (&self.shape, &self.pins) {
            (None, Some(_)) => return Err(SensorError::Pins),
            (Some(shape), _) if self.projection().chart_view(shape).is_none() => {
                return Err(SensorError::NoGelInView);
            }
            _ => {}
        }
        if !self.lamps.is_empty() && self.lamps.len() != lamps::LAMP_COUNT {
            return Err(SensorError::Lamps(self.lamps.len()));
        }
        let mut numbers = self.lamps.iter().flat_map(Lamp::numbers);
        if let Some((_, value)) = numbers.find(|(_, value)| !value.is_finite()) {
            return Err(SensorError::Number { name: "lamps", value, allowed: "finite" });
        }
        if let Some(residual) = &self.light_residual {
            check_term_counts("light_residual", residual.channels(), &residual::TERM_COUNTS)?;
        }
        for pattern in self.leds.iter().filter_map(|led| led.pattern.as_deref()) {
            check_term_counts("pattern of an LED", pattern.channels(), &light_pattern::TERM_COUNTS)?;
        }
        match &self.background {
            Background::Photograph(photograph) if [photograph.width, photograph.height] != self.resolution_px => {
                Err(SensorError::BackgroundSize {
                    found: [photograph.width, photograph.height],
                    expected: self.resolution_px,
                })
            }
            _ => Ok(()),
        }
    }
}

/// Checks how many coefficients each channel of a polynomial has.
fn check_term_counts(name: &'static str, channels: [&[f64]; 3], allowed: &'static [usize]) -> Result<(), SensorError> {
    match channels.into_iter().map(<[f64]>::len).find(|count| !allowed.contains(count)) {
        Some(found) => Err(SensorError::Coefficients { name, found, allowed }),
        None => Ok(()),
    }
}
