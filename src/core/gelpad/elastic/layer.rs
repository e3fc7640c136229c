//! Response of a linear elastic layer bonded to a rigid shell: its Green's functions in the frequency domain.
//!
//! The layer has thickness h, Young's modulus 1 and Poisson ratio nu. On its free surface act a pressure p and
//! tractions t_l along and t_t across the wave vector q. The displacements are w = G p - i C t_l, u_l = i C p + H t_l,
//! u_t = T t_t. The functions follow from the plane-strain solution of a strip with a fixed base (as in Johnson 1985,
//! section 5.8). Growing exponentials are divided out, so that the formulas hold for all q h. Displacements scale with
//! 1 / E.

use crate::gelpad::material::Material;

/// An elastic layer bonded to a rigid shell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticLayer {
    /// Thickness h, mm.
    pub thickness_mm: f64,
    /// Poisson ratio nu, 0 to 0.4999. At 0.5 an infinitely wide layer could not be compressed at all.
    pub poisson_ratio: f64,
}

impl ElasticLayer {
    /// Returns the layer of a pad of this material.
    pub fn new(material: &Material) -> Self {
        Self { thickness_mm: material.thickness_mm, poisson_ratio: material.poisson_ratio }
    }

    /// Returns G, mm: normal displacement under pressure of frequency `q` (rad/mm).
    pub fn normal_compliance(self, q: f64) -> f64 {
        let (nu, h) = (self.poisson_ratio, self.thickness_mm);
        // The limit q = 0: uniaxial compression.
        if q * h < 1e-9 {
            return (1.0 + nu) * (1.0 - 2.0 * nu) * h / (1.0 - nu);
        }
        let ResponseTerms { kappa, mu, s, e, sinh, denominator } = ResponseTerms::new(self, q);
        // e (sinh 2s - 2s), computed by its series where the difference would cancel.
        let x = 2.0 * s;
        let excess = if x >= 1.2 {
            sinh - x * e
        } else {
            let series = [156.0, 110.0, 72.0, 42.0, 20.0].iter().fold(1.0, |sum, n| 1.0 + x * x / n * sum);
            e * x * x * x / 6.0 * series
        };
        (1.0 - nu) * 2.0 * ((kappa - 1.0) * sinh + excess) / (mu * q * denominator)
    }

    /// Returns H, mm: displacement along q under traction along q.
    pub fn tangential_compliance(self, q: f64) -> f64 {
        if q * self.thickness_mm < 1e-9 {
            return self.thickness_mm * 2.0 * (1.0 + self.poisson_ratio);
        }
        let ResponseTerms { kappa, mu, s, e, sinh, denominator } = ResponseTerms::new(self, q);
        (1.0 - self.poisson_ratio) * 2.0 * (kappa * sinh + 2.0 * s * e) / (mu * q * denominator)
    }

    /// Returns C, mm: displacement along q under pressure, a quarter period ahead of it.
    pub fn coupling_compliance(self, q: f64) -> f64 {
        if q * self.thickness_mm < 1e-9 {
            return 0.0;
        }
        let ResponseTerms { kappa, mu, s, e, denominator, .. } = ResponseTerms::new(self, q);
        let half_cosh = libm::expm1(-2.0 * s);
        (kappa * (kappa - 1.0) * half_cosh * half_cosh / 4.0 - 2.0 * s * s * e) / (mu * q * denominator)
    }

    /// Returns T, mm: displacement across q under traction across q.
    pub fn transverse_compliance(self, q: f64) -> f64 {
        let mu = 0.5 / (1.0 + self.poisson_ratio);
        if q * self.thickness_mm < 1e-9 {
            return self.thickness_mm / mu;
        }
        libm::tanh(q * self.thickness_mm) / (mu * q)
    }

    /// Returns the limit of G q for large q h, that of a half-space.
    pub fn half_space_compliance(self) -> f64 {
        2.0 * (1.0 - self.poisson_ratio * self.poisson_ratio)
    }

    /// Returns the largest G over all q.
    pub fn largest_compliance(self) -> f64 {
        // A scan up to q h = 20, where the layer is a half-space already.
        let step = 0.01 / self.thickness_mm;
        (0..2000).map(|k| self.normal_compliance(f64::from(k) * step)).fold(0.0, f64::max)
    }
}

/// Terms that the functions share. Everything that grows like exp(2 s) is multiplied by `e`.
struct ResponseTerms {
    kappa: f64,
    mu: f64,
    /// q h.
    s: f64,
    /// exp(-2 s).
    e: f64,
    /// e sinh 2s.
    sinh: f64,
    /// e D.
    denominator: f64,
}

impl ResponseTerms {
    fn new(layer: ElasticLayer, q: f64) -> Self {
        let kappa = 3.0 - 4.0 * layer.poisson_ratio;
        let s = q * layer.thickness_mm;
        let e = libm::exp(-2.0 * s);
        Self {
            kappa,
            mu: 0.5 / (1.0 + layer.poisson_ratio),
            s,
            e,
            sinh: -0.5 * libm::expm1(-4.0 * s),
            denominator: kappa * (1.0 + e * e) + e * (4.0 * s * s + 1.0 + kappa * kappa),
        }
    }
}
