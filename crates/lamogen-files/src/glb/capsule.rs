//! The mesh of a capsule: the surface around two spheres.

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::{DQuat, DVec3};

/// Two spheres and the cone between them that touches both.
#[derive(Clone, Copy, Debug)]
pub(super) struct Capsule {
    pub(super) ends: [DVec3; 2],
    pub(super) radii: [f64; 2],
}

/// A mesh of triangles with a normal at every vertex.
#[derive(Clone, Debug, Default)]
pub(super) struct TriangleMesh {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) triangles: Vec<[u16; 3]>,
}

/// The number of vertices of a ring around the capsule.
const SIDES: usize = 12;
/// The number of rings of each rounded end, without the pole.
const RINGS: usize = 3;

impl Capsule {
    /// Returns the surface as triangles that are counterclockwise when seen from outside.
    ///
    /// A point of the surface is one radius along its normal from the centre of its sphere. From pole to pole, the normal
    /// turns steadily; along the cone it stays the same while the centre changes. The surface therefore has no edges.
    pub(super) fn mesh(&self) -> TriangleMesh {
        let Capsule { ends, radii } = *self;
        let length = ends[0].distance(ends[1]);
        let axis = (ends[1] - ends[0]).try_normalize().unwrap_or(DVec3::Y);
        let rotation = DQuat::from_rotation_arc(DVec3::Y, axis);
        let taper = radii[0] - radii[1];
        // The angle of the normal on the cone. If one sphere is inside the other, there is no cone.
        let cone = match length > taper.abs() {
            true => (taper / length).asin(),
            false if taper == 0.0 => 0.0,
            false => FRAC_PI_2.copysign(taper),
        };
        let first = (0..RINGS).map(|ring| {
            let part = (ring + 1) as f64 / RINGS as f64;
            (0, -FRAC_PI_2 + part * (cone + FRAC_PI_2))
        });
        let second = (0..RINGS).map(|ring| {
            let part = ring as f64 / RINGS as f64;
            (1, cone + part * (FRAC_PI_2 - cone))
        });

        let mut mesh = TriangleMesh::default();
        let mut vertex = |end: usize, normal: DVec3| {
            let position = ends[end] + radii[end] * normal;
            mesh.positions.push(position.as_vec3().to_array());
            mesh.normals.push(normal.as_vec3().to_array());
        };
        vertex(0, -axis);
        for (end, height) in first.chain(second) {
            let (up, out) = height.sin_cos();
            for side in 0..SIDES {
                let (sin, cos) = (side as f64 / SIDES as f64 * TAU).sin_cos();
                vertex(end, rotation * DVec3::new(out * cos, up, -out * sin));
            }
        }
        vertex(1, axis);

        let ring = |ring: usize, side: usize| (1 + ring * SIDES + side % SIDES) as u16;
        let last = 2 * RINGS - 1;
        let top = (1 + 2 * RINGS * SIDES) as u16;
        for side in 0..SIDES {
            let (here, next) = (side, side + 1);
            mesh.triangles.push([0, ring(0, next), ring(0, here)]);
            for above in 1..=last {
                let below = above - 1;
                let corner = ring(above, next);
                mesh.triangles
                    .push([ring(below, here), ring(below, next), corner]);
                mesh.triangles
                    .push([ring(below, here), corner, ring(above, here)]);
            }
            mesh.triangles
                .push([ring(last, here), ring(last, next), top]);
        }
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    fn capsule() -> Capsule {
        Capsule {
            ends: [DVec3::new(0.1, 0.9, 0.0), DVec3::new(0.3, 0.4, -0.2)],
            radii: [0.08, 0.05],
        }
    }

    #[test]
    fn a_capsule_is_closed_and_faces_outwards() {
        let mesh = capsule().mesh();
        let mut edges = HashMap::new();
        let mut volume = 0.0;
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| glam::Vec3::from(mesh.positions[usize::from(i)]));
            volume += a.dot(b.cross(c)) / 6.0;
            let normal = (b - a).cross(c - a);
            for (i, next) in [(0, 1), (1, 2), (2, 0)] {
                let vertex_normal = glam::Vec3::from(mesh.normals[usize::from(triangle[i])]);
                assert!(vertex_normal.dot(normal) > 0.0, "{triangle:?}");
                *edges.entry((triangle[i], triangle[next])).or_insert(0) += 1;
            }
        }
        for (&(a, b), &count) in &edges {
            assert_eq!((count, edges.get(&(b, a))), (1, Some(&1)), "edge {a} {b}");
        }
        // The volume is a little less than that of the cone and half spheres: only the vertices are on their surface.
        let [r, s] = capsule().radii;
        let round = TAU / 3.0 * (r.powi(3) + s.powi(3));
        let cone =
            TAU / 6.0 * capsule().ends[0].distance(capsule().ends[1]) * (r * r + r * s + s * s);
        let share = f64::from(volume) / (round + cone);
        assert!((0.9..1.0).contains(&share), "{share}");
    }

    #[test]
    fn the_surface_is_one_radius_away_from_the_ends() {
        let Capsule { ends, radii } = capsule();
        for (point, normal) in capsule()
            .mesh()
            .positions
            .iter()
            .zip(capsule().mesh().normals)
        {
            let point = DVec3::from(point.map(f64::from));
            let gap = |end: usize| (point.distance(ends[end]) - radii[end]).abs();
            assert!(gap(0).min(gap(1)) < 1e-6);
            assert!((glam::Vec3::from(normal).length() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_capsule_without_length_is_a_sphere() {
        for radii in [[0.1, 0.1], [0.2, 0.1], [0.1, 0.2]] {
            let ends = [DVec3::ONE; 2];
            let mesh = Capsule { ends, radii }.mesh();
            let finite = |rows: &[[f32; 3]]| rows.iter().flatten().all(|x| x.is_finite());
            assert!(finite(&mesh.positions) && finite(&mesh.normals));
        }
    }
}
