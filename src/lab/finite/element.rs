//! One axisymmetric finite element of rubber: nearly incompressible neo-Hookean. Displacements are biquadratic and
//! pressures bilinear (Taylor-Hood), so that it does not lock.

/// Number of unknowns: displacements (r, z of nine nodes), then pressures of four corners.
pub const UNKNOWNS: usize = 22;
/// Number of unknowns that are displacements.
pub const DISPLACEMENTS: usize = 18;

/// Elastic constants over Young's modulus.
#[derive(Clone, Copy, Debug)]
pub struct ElasticConstants {
    /// Shear modulus.
    pub shear: f64,
    /// Lame's first constant.
    pub lame: f64,
}

impl ElasticConstants {
    /// Computes the constants from the Poisson ratio, 0 to below 0.5.
    pub fn new(poisson_ratio: f64) -> Self {
        let lame = poisson_ratio / ((1.0 + poisson_ratio) * (1.0 - 2.0 * poisson_ratio));
        // At a Poisson ratio of 0 the pressure vanishes, but its equation must stay solvable.
        Self { shear: 0.5 / (1.0 + poisson_ratio), lame: lame.max(1e-6) }
    }
}

/// An element's points of integration, which do not change as it deforms.
#[derive(Clone, Debug)]
pub struct Element {
    points: [IntegrationPoint; 9],
}

#[derive(Clone, Debug)]
struct IntegrationPoint {
    /// Area that the point stands for, times its radius.
    weight: f64,
    /// d/dr and d/dz of each node's shape function, and the shape over the radius.
    gradient: [[f64; 3]; 9],
    /// Shape functions of the pressure at the four corners.
    corners: [f64; 4],
}

/// Forces on the unknowns, and their derivatives.
#[derive(Clone, Debug)]
pub struct ElementResponse {
    /// Forces, over Young's modulus.
    pub forces: [f64; UNKNOWNS],
    /// Derivatives of the forces; symmetric.
    pub matrix: [[f64; UNKNOWNS]; UNKNOWNS],
}

/// Points and weights of Gauss's rule with three points on -1 to 1.
pub const GAUSS_3: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];

/// The quadratic shape functions on -1 to 1, and their derivatives.
pub fn quadratic_shapes(x: f64) -> ([f64; 3], [f64; 3]) {
    ([x * (x - 1.0) / 2.0, 1.0 - x * x, x * (x + 1.0) / 2.0], [x - 0.5, -2.0 * x, x + 0.5])
}

impl Element {
    /// Creates an element from its nodes at (r, z), r slowest.
    pub fn new(nodes: &[[f64; 2]; 9]) -> Self {
        let points = std::array::from_fn(|q| {
            let ((x, by_x), (y, by_y)) = (GAUSS_3[q / 3], GAUSS_3[q % 3]);
            let ((nx, dx), (ny, dy)) = (quadratic_shapes(x), quadratic_shapes(y));
            let shape: [f64; 9] = std::array::from_fn(|n| nx[n / 3] * ny[n % 3]);
            let slopes: [[f64; 2]; 9] = std::array::from_fn(|n| [dx[n / 3] * ny[n % 3], nx[n / 3] * dy[n % 3]]);
            // [d][c]: derivative of coordinate c along the element's own direction d.
            let mut jacobian = [[0.0; 2]; 2];
            let mut radius = 0.0;
            for ((at, slope), shape) in nodes.iter().zip(&slopes).zip(&shape) {
                for (row, slope) in jacobian.iter_mut().zip(slope) {
                    row[0] += slope * at[0];
                    row[1] += slope * at[1];
                }
                radius += shape * at[0];
            }
            let [[a, b], [c, d]] = jacobian;
            let determinant = a * d - b * c;
            let gradient = std::array::from_fn(|n| {
                let [u, v] = slopes[n];
                [(d * u - b * v) / determinant, (a * v - c * u) / determinant, shape[n] / radius]
            });
            let linear = |x: f64| [(1.0 - x) / 2.0, (1.0 + x) / 2.0];
            let (px, py) = (linear(x), linear(y));
            let corners = std::array::from_fn(|m| px[m / 2] * py[m % 2]);
            IntegrationPoint { weight: determinant * by_x * by_y * radius, gradient, corners }
        });
        Self { points }
    }

    /// Computes forces and their derivatives at a state. `None` if the rubber would be turned inside out.
    pub fn compute_response(&self, rubber: ElasticConstants, state: &[f64; UNKNOWNS]) -> Option<ElementResponse> {
        let mut out = ElementResponse { forces: [0.0; UNKNOWNS], matrix: [[0.0; UNKNOWNS]; UNKNOWNS] };
        for point in &self.points {
            point.add_response(rubber, state, &mut out)?;
        }
        for row in 1..UNKNOWNS {
            for column in 0..row {
                out.matrix[row][column] = out.matrix[column][row];
            }
        }
        Some(out)
    }
}

impl IntegrationPoint {
    /// Adds the point's part to the forces, and to the matrix on and above its diagonal.
    fn add_response(&self, rubber: ElasticConstants, state: &[f64; UNKNOWNS], out: &mut ElementResponse) -> Option<()> {
        let (u, p) = state.split_at(DISPLACEMENTS);
        // The deformation gradient: rr, rz, zr, zz, and around the axis.
        let mut f = [1.0, 0.0, 0.0, 1.0, 1.0];
        for (g, u) in self.gradient.iter().zip(u.chunks_exact(2)) {
            f[0] += g[0] * u[0];
            f[1] += g[1] * u[0];
            f[2] += g[0] * u[1];
            f[3] += g[1] * u[1];
            f[4] += g[2] * u[0];
        }
        let area = f[0] * f[3] - f[1] * f[2];
        let volume = area * f[4];
        if !(volume > 0.02 && f[4] > 0.0) {
            return None;
        }
        // Inverse of the deformation gradient, transposed.
        let inverse = [f[3] / area, -f[2] / area, -f[1] / area, f[0] / area, 1.0 / f[4]];
        let pressure: f64 = self.corners.iter().zip(p).map(|(shape, p)| shape * p).sum();
        let excess = pressure - rubber.shear;
        let w = self.weight;
        let stress: [f64; 5] = std::array::from_fn(|k| w * (rubber.shear * f[k] + excess * inverse[k]));
        for (n, g) in self.gradient.iter().enumerate() {
            out.forces[2 * n] += g[0] * stress[0] + g[1] * stress[1] + g[2] * stress[4];
            out.forces[2 * n + 1] += g[0] * stress[2] + g[1] * stress[3];
        }
        let volume_error = w * (libm::log(volume) - pressure / rubber.lame);

        // Derivatives of the stress in the section, and around the axis.
        let tangent: [[f64; 4]; 4] = std::array::from_fn(|a| {
            let (i, k) = (a / 2, a % 2);
            std::array::from_fn(|b| {
                let (m, l) = (b / 2, b % 2);
                let own = if a == b { rubber.shear } else { 0.0 };
                w * (own - excess * inverse[2 * m + k] * inverse[2 * i + l])
            })
        });
        let around = w * (rubber.shear - excess * inverse[4] * inverse[4]);
        for (n, g) in self.gradient.iter().enumerate() {
            // The rows of both displacements of the node.
            let own: [[f64; 4]; 2] = std::array::from_fn(|i| {
                std::array::from_fn(|b| g[0] * tangent[2 * i][b] + g[1] * tangent[2 * i + 1][b])
            });
            let hoop = around * g[2];
            for (m, h) in self.gradient.iter().enumerate().skip(n) {
                for (i, own) in own.iter().enumerate() {
                    let row = &mut out.matrix[2 * n + i];
                    row[2 * m] += own[0] * h[0] + own[1] * h[1];
                    row[2 * m + 1] += own[2] * h[0] + own[3] * h[1];
                }
                out.matrix[2 * n][2 * m] += hoop * h[2];
            }
            let dilation = [
                w * (g[0] * inverse[0] + g[1] * inverse[1] + g[2] * inverse[4]),
                w * (g[0] * inverse[2] + g[1] * inverse[3]),
            ];
            for (i, dilation) in dilation.into_iter().enumerate() {
                for (to, shape) in out.matrix[2 * n + i][DISPLACEMENTS..].iter_mut().zip(&self.corners) {
                    *to += dilation * shape;
                }
            }
        }
        for (m, shape) in self.corners.iter().enumerate() {
            out.forces[DISPLACEMENTS + m] += shape * volume_error;
            for (to, other) in out.matrix[DISPLACEMENTS + m][DISPLACEMENTS..].iter_mut().zip(&self.corners) {
                *to -= w * shape * other / rubber.lame;
            }
        }
        Some(())
    }
}
