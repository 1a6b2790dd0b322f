//! The surfaces of glTF files: triangles with their bones, and what they look like.

use std::collections::HashMap;
use std::path::Path;

use gltf_json::Index;
use gltf_json::accessor::Accessor;
use serde_json::Value;

use super::GlbError;
use super::container::{FormatProblem, GltfFile};
use super::reduction::{DocumentPart, index};

/// The surfaces of a file with all that they refer to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surfaces {
    /// The surfaces, in the order of their nodes.
    pub surfaces: Vec<Surface>,
    /// The materials.
    pub materials: Vec<SurfaceMaterial>,
    /// The images of the textures as they are in the file.
    pub images: Vec<SurfaceImage>,
}

/// Triangles of one material at a node. Every vertex has a row in each list.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// The index of the node.
    pub node: usize,
    /// The index of the skin whose joints move the vertices; without one, the node does.
    pub skin: Option<usize>,
    /// The positions of the vertices, in the units of the node or the skin.
    pub positions: Vec<[f32; 3]>,
    /// The normals of the vertices; those of the triangles if the file has none.
    pub normals: Vec<[f32; 3]>,
    /// The places of the vertices on the texture of their material; zero if the file has none.
    pub texture_coordinates: Vec<[f32; 2]>,
    /// Red, green, blue and opacity of the vertices from 0 to 1, in linear light, which are multiplied with the colour of
    /// the material; 1 if the file has none.
    pub colours: Vec<[f32; 4]>,
    /// The joints of the skin that move each vertex; zero without a skin.
    pub joints: Vec<[u16; 4]>,
    /// The weights of those joints; their sum is 1.
    pub weights: Vec<[f32; 4]>,
    /// The vertices of the triangles, three for each.
    pub indices: Vec<u32>,
    /// The index of the material in [`Surfaces::materials`].
    pub material: Option<usize>,
}

/// What a surface looks like.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceMaterial {
    /// Red, green, blue and opacity from 0 to 1, in linear light.
    pub colour: [f32; 4],
    /// The index of the image in [`Surfaces::images`] that is multiplied with the colour.
    pub image: Option<usize>,
    /// The opacity below which nothing is drawn, if the material has one.
    pub cutoff: Option<f32>,
    /// Whether the surface is translucent.
    pub is_translucent: bool,
}

/// An image as it is in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceImage {
    /// The media type, such as `image/png`.
    pub media_type: String,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// The most vertices of all surfaces together.
const MAX_VERTICES: usize = 400_000;
/// The most vertices of all triangles together, and the most rows of all accessors that are read.
const MAX_ROWS: u64 = 4_000_000;

/// The most bytes of all images together.
const MAX_IMAGE_BYTES: usize = 1 << 26;

/// Returns the surfaces of a `.glb` or `.gltf` file that nodes show.
///
/// `path` is used only in error messages. Buffers and images must be in the file.
///
/// # Errors
///
/// If the file is not glTF 2 or is damaged, its triangles are compressed with Draco, or it has more than 400,000 vertices or 64 MiB of images.
pub fn surfaces(bytes: &[u8], path: &Path) -> Result<Surfaces, GlbError> {
    let failed = |reason: FormatProblem| GlbError::Format {
        path: path.to_owned(),
        reason,
    };
    let file = GltfFile::parse(bytes, path, None, DocumentPart::Surfaces)?;
    let mut reader = SurfaceReader {
        file: &file,
        rows: 0,
        vertices: 0,
        image_bytes: 0,
    };
    reader.read().map_err(failed)
}

/// What has been read of a file.
struct SurfaceReader<'f> {
    file: &'f GltfFile<'f>,
    rows: u64,
    vertices: usize,
    image_bytes: usize,
}

impl SurfaceReader<'_> {
    fn read(&mut self) -> Result<Surfaces, FormatProblem> {
        let document = &self.file.document;
        let mut surfaces = Vec::new();
        let nodes = document["nodes"].as_array().into_iter().flatten();
        for (node, value) in nodes.enumerate() {
            let Some(mesh) = index(&value["mesh"]) else {
                continue;
            };
            let mesh_value = &document["meshes"][mesh];
            let shape_weights = [&value["weights"], &mesh_value["weights"]]
                .into_iter()
                .find_map(Value::as_array);
            let shape_weights = shape_weights.map_or(&[][..], Vec::as_slice);
            let primitives = mesh_value["primitives"].as_array();
            for (place, primitive) in primitives.into_iter().flatten().enumerate() {
                let skin = index(&value["skin"]);
                let surface = self.surface(primitive, node, skin, shape_weights);
                let surface = surface
                    .map_err(|problem| format!("meshes[{mesh}].primitives[{place}]: {problem}"))?;
                surfaces.extend(surface);
            }
        }
        let mut images = Vec::new();
        let mut known = HashMap::new();
        let mut materials = Vec::new();
        let listed = document["materials"].as_array().into_iter().flatten();
        for (place, value) in listed.enumerate() {
            let material = self.material(value, &mut images, &mut known);
            materials.push(material.map_err(|problem| format!("materials[{place}]: {problem}"))?);
        }
        for surface in &mut surfaces {
            surface.material = surface.material.filter(|place| *place < materials.len());
        }
        Ok(Surfaces {
            surfaces,
            materials,
            images,
        })
    }

    /// Reads the rows of an accessor of `N` numbers, if there is one.
    fn rows<const N: usize>(
        &mut self,
        accessor: &Value,
    ) -> Result<Option<Vec<[f64; N]>>, FormatProblem> {
        let Some(accessor) = index(accessor) else {
            return Ok(None);
        };
        let accessor: Index<Accessor> = Index::new(accessor as u32);
        self.rows = self.rows.saturating_add(self.file.count(accessor));
        if self.rows > MAX_ROWS {
            return Err(format!(
                "expected at most {MAX_ROWS} rows in all surfaces, found more"
            ));
        }
        self.file.floats(accessor).map(Some)
    }

    /// Adds the shapes of a primitive (morph targets) to the rows of an attribute, each by its weight.
    fn add_shapes(
        &mut self,
        rows: &mut [[f64; 3]],
        primitive: &Value,
        attribute: &str,
        weights: &[Value],
    ) -> Result<(), FormatProblem> {
        let targets = primitive["targets"].as_array().into_iter().flatten();
        for (place, (target, weight)) in targets.zip(weights).enumerate() {
            let weight = weight.as_f64().unwrap_or(0.0);
            if weight == 0.0 {
                continue;
            }
            let Some(changes) = self.rows::<3>(&target[attribute])? else {
                continue;
            };
            if changes.len() != rows.len() {
                let (expected, found) = (rows.len(), changes.len());
                return Err(format!(
                    "targets[{place}].{attribute}: expected {expected} rows, found {found}"
                ));
            }
            for (row, change) in rows.iter_mut().flatten().zip(changes.iter().flatten()) {
                *row += weight * change;
            }
        }
        Ok(())
    }

    /// Reads the colours of vertices, of three or four numbers.
    fn colours(&mut self, accessor: &Value) -> Result<Option<Vec<[f64; 4]>>, FormatProblem> {
        let document = &self.file.document;
        let kind = index(accessor).and_then(|place| document["accessors"][place]["type"].as_str());
        let colours = match kind {
            Some("VEC3") => { self.rows::<3>(accessor)? }.map(|rows| {
                let opaque = rows
                    .into_iter()
                    .map(|[red, green, blue]| [red, green, blue, 1.0]);
                opaque.collect::<Vec<_>>()
            }),
            _ => self.rows::<4>(accessor)?,
        };
        Ok(colours.map(|rows| {
            let within = rows.into_iter().map(|row| row.map(|x| x.clamp(0.0, 1.0)));
            within.collect()
        }))
    }

    /// Reads where vertices are on the base texture of their material.
    fn texture_coordinates(
        &mut self,
        primitive: &Value,
    ) -> Result<Option<Vec<[f64; 2]>>, FormatProblem> {
        let document = &self.file.document;
        let material = index(&primitive["material"]);
        let texture = material.map_or(&Value::Null, |place| {
            &document["materials"][place]["pbrMetallicRoughness"]["baseColorTexture"]
        });
        let change = &texture["extensions"]["KHR_texture_transform"];
        let set = [&change["texCoord"], &texture["texCoord"]];
        let set = set.into_iter().find_map(index).unwrap_or(0);
        let rows = self.rows::<2>(&primitive["attributes"][format!("TEXCOORD_{set}")])?;
        if change.is_null() {
            return Ok(rows);
        }
        let number = |value: &Value, default: f64| value.as_f64().unwrap_or(default);
        let [offset, scale] = [("offset", 0.0), ("scale", 1.0)]
            .map(|(name, default)| [0, 1].map(|axis| number(&change[name][axis], default)));
        // Counterclockwise as one looks at the texture, whose second axis goes down.
        let (sin, cos) = number(&change["rotation"], 0.0).sin_cos();
        let moved = |[u, v]: [f64; 2]| {
            let (u, v) = (scale[0] * u, scale[1] * v);
            [offset[0] + cos * u + sin * v, offset[1] + cos * v - sin * u]
        };
        Ok(rows.map(|rows| rows.into_iter().map(moved).collect()))
    }

    /// Reads the triangles of a primitive; `None` if it has no triangles. `shape_weights` are those of its shapes.
    fn surface(
        &mut self,
        primitive: &Value,
        node: usize,
        skin: Option<usize>,
        shape_weights: &[Value],
    ) -> Result<Option<Surface>, FormatProblem> {
        if !primitive["extensions"]["KHR_draco_mesh_compression"].is_null() {
            return Err("expected triangles without compression or with meshopt's, found those of Draco, which are not read".into());
        }
        let mode = primitive["mode"].as_u64().unwrap_or(4);
        if !(4..=6).contains(&mode) {
            return Ok(None);
        }
        let attributes = &primitive["attributes"];
        let Some(mut positions) = self.rows::<3>(&attributes["POSITION"])? else {
            return Ok(None);
        };
        self.add_shapes(&mut positions, primitive, "POSITION", shape_weights)?;
        let count = positions.len();
        let corners: Vec<u32> = match self.rows::<1>(&primitive["indices"])? {
            Some(rows) => rows.into_iter().map(|[corner]| corner as u32).collect(),
            None => (0..count as u32).collect(),
        };
        if let Some(corner) = corners.iter().find(|corner| **corner as usize >= count) {
            return Err(format!("expected indices below {count}, found {corner}"));
        }
        let mut normals = self.rows::<3>(&attributes["NORMAL"])?;
        if let Some(normals) = &mut normals {
            self.add_shapes(normals, primitive, "NORMAL", shape_weights)?;
        }
        let texture = self.texture_coordinates(primitive)?;
        let colours = self.colours(&attributes["COLOR_0"])?;
        let skin = skin.filter(|_| !attributes["JOINTS_0"].is_null());
        let (joints, weights) = match skin {
            None => (None, None),
            Some(_) => (
                self.rows::<4>(&attributes["JOINTS_0"])?,
                self.rows::<4>(&attributes["WEIGHTS_0"])?,
            ),
        };
        let mut corners = triangles(&corners, mode);
        let as_long = |rows: usize, name: &str| match rows == count {
            true => Ok(()),
            false => Err(format!("{name}: expected {count} rows, found {rows}")),
        };
        for (name, rows) in [
            ("NORMAL", normals.as_ref().map(Vec::len)),
            ("TEXCOORD", texture.as_ref().map(Vec::len)),
            ("COLOR_0", colours.as_ref().map(Vec::len)),
            ("JOINTS_0", joints.as_ref().map(Vec::len)),
            ("WEIGHTS_0", weights.as_ref().map(Vec::len)),
        ] {
            rows.map_or(Ok(()), |rows| as_long(rows, name))?;
        }
        // Surfaces share long lists of vertices; each keeps its own.
        let mut kept: Vec<usize> = Vec::new();
        if normals.is_none() {
            // Without normals, a surface is flat: no two triangles share a vertex.
            kept = corners.iter().map(|corner| *corner as usize).collect();
            corners = (0..kept.len() as u32).collect();
        } else {
            let mut places = vec![u32::MAX; count];
            for corner in &mut corners {
                let place = &mut places[*corner as usize];
                if *place == u32::MAX {
                    *place = kept.len() as u32;
                    kept.push(*corner as usize);
                }
                *corner = *place;
            }
        }
        self.vertices += kept.len();
        if self.vertices > MAX_VERTICES {
            return Err(format!(
                "expected at most {MAX_VERTICES} vertices in all surfaces, found more"
            ));
        }
        positions = kept.iter().map(|place| positions[*place]).collect();
        normals = normals.map(|normals| kept.iter().map(|place| normals[*place]).collect());
        let single = |row: [f64; 3]| row.map(|x| x as f32);
        let normals = normals.unwrap_or_else(|| flat_normals(&positions));
        Ok(Some(Surface {
            node,
            skin,
            positions: positions.into_iter().map(single).collect(),
            normals: normals.into_iter().map(single).collect(),
            texture_coordinates: kept_rows(&kept, texture, [0.0; 2], |row| row.map(|x| x as f32)),
            colours: kept_rows(&kept, colours, [1.0; 4], |row| row.map(|x| x as f32)),
            joints: kept_rows(&kept, joints, [0; 4], |row| row.map(|x| x as u16)),
            weights: kept_rows(&kept, weights, WHOLE, whole),
            indices: corners,
            material: index(&primitive["material"]),
        }))
    }

    /// Reads a material. Images that it uses are added to `images`; `known` has the place of each there.
    fn material(
        &mut self,
        value: &Value,
        images: &mut Vec<SurfaceImage>,
        known: &mut HashMap<usize, Option<usize>>,
    ) -> Result<SurfaceMaterial, FormatProblem> {
        let surface = &value["pbrMetallicRoughness"];
        let factor = |place: usize| {
            let number = surface["baseColorFactor"][place].as_f64().unwrap_or(1.0);
            number.clamp(0.0, 1.0) as f32
        };
        let texture = index(&surface["baseColorTexture"]["index"]);
        let source = texture.and_then(|texture| {
            let texture = &self.file.document["textures"][texture];
            index(&texture["source"])
                .or_else(|| index(&texture["extensions"]["EXT_texture_webp"]["source"]))
        });
        let image = match source {
            None => None,
            Some(source) => match known.get(&source) {
                Some(place) => *place,
                None => {
                    let image = self
                        .image(source)
                        .map_err(|problem| format!("images[{source}]: {problem}"))?;
                    self.image_bytes += image.as_ref().map_or(0, |image| image.bytes.len());
                    if self.image_bytes > MAX_IMAGE_BYTES {
                        return Err(format!(
                            "expected at most {MAX_IMAGE_BYTES} bytes in all images, found more"
                        ));
                    }
                    let place = image.map(|image| {
                        images.push(image);
                        images.len() - 1
                    });
                    known.insert(source, place);
                    place
                }
            },
        };
        let mode = value["alphaMode"].as_str().unwrap_or("OPAQUE");
        Ok(SurfaceMaterial {
            colour: std::array::from_fn(factor),
            image,
            cutoff: (mode == "MASK").then(|| value["alphaCutoff"].as_f64().unwrap_or(0.5) as f32),
            is_translucent: mode == "BLEND",
        })
    }

    /// Reads an image; `None` if it is in another file.
    fn image(&self, source: usize) -> Result<Option<SurfaceImage>, FormatProblem> {
        let image = &self.file.document["images"][source];
        if let Some(view) = index(&image["bufferView"]) {
            let bytes = self.file.view(Index::new(view as u32))?.to_vec();
            let media_type = image["mimeType"].as_str().unwrap_or("image/png").to_owned();
            return Ok(Some(SurfaceImage { media_type, bytes }));
        }
        let data = { image["uri"].as_str() }.and_then(|uri| uri.strip_prefix("data:"));
        let Some(data) = data else {
            return Ok(None);
        };
        let media_type = data.split([';', ',']).next().unwrap_or_default().to_owned();
        let bytes = super::container::decode_data_uri(data)?;
        Ok(Some(SurfaceImage { media_type, bytes }))
    }
}

/// Returns the converted rows of the vertices that are kept; `missing` for each if there are no rows.
fn kept_rows<R: Copy, T: Copy>(
    kept: &[usize],
    rows: Option<Vec<R>>,
    missing: T,
    convert: impl Fn(R) -> T,
) -> Vec<T> {
    match rows {
        None => vec![missing; kept.len()],
        Some(rows) => kept.iter().map(|place| convert(rows[*place])).collect(),
    }
}

/// The weights of a vertex that one joint moves.
const WHOLE: [f32; 4] = [1.0, 0.0, 0.0, 0.0];

/// Returns weights whose sum is 1.
fn whole(weights: [f64; 4]) -> [f32; 4] {
    let weights = weights.map(|weight| weight.max(0.0));
    let sum: f64 = weights.iter().sum();
    match sum > 1e-6 {
        true => weights.map(|weight| (weight / sum) as f32),
        false => WHOLE,
    }
}

/// Returns the triangles of a list (mode 4), a strip (5) or a fan (6).
fn triangles(corners: &[u32], mode: u64) -> Vec<u32> {
    match mode {
        5 => { corners.windows(3).enumerate() }
            .flat_map(|(place, three)| match place % 2 {
                0 => [three[0], three[1], three[2]],
                _ => [three[1], three[0], three[2]],
            })
            .collect(),
        6 => { corners.iter().skip(1).zip(corners.iter().skip(2)) }
            .flat_map(|(second, third)| [corners[0], *second, *third])
            .collect(),
        _ => corners[..corners.len() / 3 * 3].to_vec(),
    }
}

/// Returns the normal of its triangle for every vertex; three vertices are a triangle.
fn flat_normals(positions: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let normals = positions.chunks_exact(3).flat_map(|corners| {
        let [a, b, c] = [0, 1, 2].map(|corner| glam::DVec3::from(corners[corner]));
        let normal = (b - a).cross(c - a).normalize_or(glam::DVec3::Y);
        [normal.to_array(); 3]
    });
    normals.collect()
}
