//! Triangle meshes from glTF files.

mod accessor;
mod gltf;
mod uri;

use std::path::Path;

use inr_core::MeshRegion;

use crate::volume::{Affine, read_bounded};
use crate::{Error, Result};

/// The name of the format in messages.
const FORMAT: &str = "glTF";

/// Triangles in space: what a glTF scene is made of, without colours.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Positions of the corners, in the file's world: glTF uses metres, y up.
    pub vertices: Vec<[f32; 3]>,
    /// Three indices of vertices each, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The inside of the mesh, as a region.
    ///
    /// # Errors
    /// Those of [`MeshRegion::new`], above all [`inr_core::Error::OpenMesh`].
    pub fn to_region(&self) -> inr_core::Result<MeshRegion> {
        MeshRegion::new(&self.vertices, &self.triangles)
    }

    /// The mesh moved by a map of its coordinates, for example from metres to a volume's millimetres.
    /// The corners of triangles are reordered where the map is a reflection.
    pub fn transformed(&self, map: &Affine) -> Self {
        let mut out = self.clone();
        for vertex in &mut out.vertices {
            *vertex = crate::volume::apply(map, vertex.map(f64::from)).map(|v| v as f32);
        }
        if crate::volume::determinant(map) < 0.0 {
            out.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        out
    }
}

/// Reads the triangles of a glTF file's default scene (`.glb`, or `.gltf` with its buffers beside it or
/// inside of it), with the transforms of all nodes applied.
///
/// Strips and fans become triangles; points and lines are left out; morph targets, skins, animations and
/// materials are ignored. A file without scenes gives all nodes that are nobody's child. The
/// triangles may take up to `limit_bytes` in memory, as instancing makes them many; the file and all of its
/// buffers twice as much each.
///
/// # Errors
/// [`Error::NotFound`], [`Error::Io`], [`Error::UnsupportedFeature`] for required extensions such as Draco
/// and for sparse accessors, [`Error::Corrupt`] for what the format forbids (nodes in a cycle, indices
/// out of range, buffers that are too short), [`Error::TooLarge`], and [`Error::Empty`] without triangles.
pub fn read_mesh(path: impl AsRef<Path>, limit_bytes: u64) -> Result<Mesh> {
    let path = path.as_ref();
    let bytes = read_bounded(path, limit_bytes)?;
    let beside = |name: &str| read_bounded(&path.with_file_name(name), limit_bytes);
    decode(path, &bytes, limit_bytes, &beside)
}

/// The same for a file that is in memory already, with all its buffers inside; `name` stands for the path
/// in messages.
///
/// # Errors
/// Those of [`read_mesh`] without the ones of the file system; [`Error::UnsupportedFeature`] for buffers in
/// other files.
pub fn decode_mesh(name: impl AsRef<Path>, bytes: &[u8], limit_bytes: u64) -> Result<Mesh> {
    let name = name.as_ref();
    decode(name, bytes, limit_bytes, &|file| {
        let what = format!("a buffer in another file, {file:?} (read it by its path)");
        Err(Error::UnsupportedFeature { path: name.to_path_buf(), format: FORMAT, what })
    })
}

fn decode(
    path: &Path,
    bytes: &[u8],
    limit_bytes: u64,
    beside: &dyn Fn(&str) -> Result<Vec<u8>>,
) -> Result<Mesh> {
    if bytes.is_empty() {
        return Err(Error::Empty { path: path.to_path_buf() });
    }
    let mesh = gltf::decode(bytes, limit_bytes, beside).map_err(|f| f.at(path, FORMAT, "read"))?;
    match mesh.triangles.is_empty() {
        true => Err(Error::Empty { path: path.to_path_buf() }),
        false => Ok(mesh),
    }
}
