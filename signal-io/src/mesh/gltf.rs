//! The glTF 2.0 scene: its container, its nodes, its triangles.
//!
//! Only what makes triangles is read, with serde: the usual crate trusts indices and lengths that this one
//! must check. Source: "glTF 2.0 Specification", Khronos Group.

use serde::Deserialize;
use serde_json::Value;

use super::Mesh;
use super::accessor::{self, Accessor, View};
use super::uri::{self, Source};
use crate::error::Fault;
use crate::volume::{Affine, compose, determinant, diagonal};
use crate::{Result as FileResult, volume};

/// Extensions that may be required, as triangles do not depend on them.
const HARMLESS: [&str; 3] = ["KHR_materials_unlit", "KHR_texture_transform", "KHR_texture_basisu"];

/// Transforms of nodes inside of nodes, for hostile files: real scenes have tens.
const MAX_DEPTH: usize = 4096;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Document {
    asset: Asset,
    scene: Option<usize>,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    nodes: Vec<Node>,
    #[serde(default)]
    meshes: Vec<MeshEntry>,
    #[serde(default)]
    accessors: Vec<Accessor>,
    #[serde(default)]
    buffer_views: Vec<View>,
    #[serde(default)]
    buffers: Vec<Buffer>,
    #[serde(default)]
    extensions_required: Vec<String>,
}

#[derive(Deserialize)]
struct Asset {
    version: String,
}

#[derive(Deserialize)]
struct Scene {
    #[serde(default)]
    nodes: Vec<usize>,
}

#[derive(Deserialize)]
struct Node {
    #[serde(default)]
    children: Vec<usize>,
    mesh: Option<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct MeshEntry {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    attributes: Attributes,
    indices: Option<usize>,
    mode: Option<u32>,
    extensions: Option<Value>,
}

#[derive(Deserialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Buffer {
    uri: Option<String>,
    byte_length: u64,
}

pub(super) fn decode(
    bytes: &[u8],
    limit_bytes: u64,
    beside: &dyn Fn(&str) -> FileResult<Vec<u8>>,
) -> Result<Mesh, Fault> {
    let (json, binary) = split(bytes)?;
    let document: Document =
        serde_json::from_slice(json).map_err(|e| Fault::corrupt(e.to_string()))?;
    if !document.asset.version.starts_with("2.") {
        return Err(Fault::Feature(format!("version {:?}", document.asset.version)));
    }
    let harmless = |name: &&String| !HARMLESS.contains(&name.as_str());
    if let Some(name) = document.extensions_required.iter().find(harmless) {
        return Err(Fault::Feature(format!("the required extension {name}")));
    }
    let buffers = load_buffers(&document, binary, limit_bytes, beside)?;
    let mut scene = Collect { document, buffers, limit_bytes, mesh: Mesh::default() };
    scene.run()?;
    Ok(scene.mesh)
}

/// The text, and the binary chunk of a GLB container.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), Fault> {
    let Some(rest) = bytes.strip_prefix(b"glTF") else {
        return match bytes.iter().find(|b| !b.is_ascii_whitespace()) {
            Some(b'{') => Ok((bytes, None)),
            _ => Err(Fault::corrupt("it begins neither as JSON nor as GLB")),
        };
    };
    let word =
        |at: usize| rest.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let version = word(0).ok_or_else(Fault::cut_short)?;
    if version != 2 {
        return Err(Fault::Feature(format!("container version {version}")));
    }
    let length = word(4).ok_or_else(Fault::cut_short)? as usize;
    if bytes.len() < length {
        return Err(Fault::cut_short());
    }
    let mut chunks = &bytes[12.min(length)..length];
    let mut json = None;
    while let Some((head, rest)) = chunks.split_at_checked(8) {
        let length = u32::from_le_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let (content, rest) = rest.split_at_checked(length).ok_or_else(Fault::cut_short)?;
        match (&head[4..], json) {
            (b"JSON", None) => json = Some(content),
            (b"BIN\0", Some(json)) => return Ok((json, Some(content))),
            _ => {} // Chunks of other kinds are to be skipped.
        }
        chunks = rest;
    }
    json.map(|json| (json, None)).ok_or_else(Fault::cut_short)
}

fn load_buffers(
    document: &Document,
    binary: Option<&[u8]>,
    limit_bytes: u64,
    beside: &dyn Fn(&str) -> FileResult<Vec<u8>>,
) -> Result<Vec<Vec<u8>>, Fault> {
    let (mut buffers, mut total) = (Vec::new(), 0u64);
    for (number, buffer) in document.buffers.iter().enumerate() {
        let mut bytes = match (&buffer.uri, binary) {
            (Some(uri), _) => match uri::resolve(uri)? {
                Source::Inside(bytes) => bytes,
                Source::Beside(name) => beside(&name)?,
            },
            (None, Some(binary)) if number == 0 => binary.to_vec(),
            (None, _) => return Err(Fault::Feature("buffers without data".to_owned())),
        };
        if (bytes.len() as u64) < buffer.byte_length {
            let (found, expected) = (bytes.len(), buffer.byte_length);
            let what = format!("buffer {number} has {found} of {expected} bytes");
            return Err(Fault::Corrupt(what));
        }
        // A file may be named again and again.
        total += bytes.len() as u64;
        if total > limit_bytes.saturating_mul(2) {
            return Err(Fault::TooLarge { needed: total, limit: limit_bytes.saturating_mul(2) });
        }
        bytes.truncate(buffer.byte_length as usize);
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// The walk through the nodes.
struct Collect {
    document: Document,
    buffers: Vec<Vec<u8>>,
    limit_bytes: u64,
    mesh: Mesh,
}

impl Collect {
    fn run(&mut self) -> Result<(), Fault> {
        let count = self.document.nodes.len();
        // A tree has one way to each node; every other graph is forbidden and may be endless.
        let mut seen = vec![false; count];
        let identity = diagonal([1.0; 3]);
        let mut stack: Vec<(usize, Affine, usize)> =
            self.roots()?.into_iter().rev().map(|node| (node, identity, 0)).collect();
        while let Some((index, parent, depth)) = stack.pop() {
            let node =
                self.document.nodes.get(index).ok_or_else(|| {
                    Fault::corrupt(format!("it refers to node {index} of {count}"))
                })?;
            if std::mem::replace(&mut seen[index], true) || depth > MAX_DEPTH {
                return Err(Fault::corrupt(format!(
                    "node {index} is its own ancestor or has two parents"
                )));
            }
            let map = compose(&parent, &transform(node)?);
            let children = node.children.iter().rev().map(|child| (*child, map, depth + 1));
            stack.extend(children);
            if let Some(mesh) = node.mesh {
                self.add(mesh, &map)?;
            }
        }
        Ok(())
    }

    /// The nodes of the scene.
    fn roots(&self) -> Result<Vec<usize>, Fault> {
        let (scenes, nodes) = (&self.document.scenes, &self.document.nodes);
        let index = self.document.scene.unwrap_or(0);
        if let Some(scene) = scenes.get(index) {
            return Ok(scene.nodes.clone());
        }
        if self.document.scene.is_some() {
            return Err(Fault::corrupt(format!("it refers to scene {index} of {}", scenes.len())));
        }
        let mut is_child = vec![false; nodes.len()];
        for child in nodes.iter().flat_map(|n| &n.children) {
            if let Some(entry) = is_child.get_mut(*child) {
                *entry = true;
            }
        }
        if !nodes.is_empty() && is_child.iter().all(|c| *c) {
            return Err(Fault::corrupt("every node is another one's child: they go in a circle"));
        }
        Ok((0..nodes.len()).filter(|k| !is_child[*k]).collect())
    }

    /// Adds the triangles of a mesh.
    fn add(&mut self, index: usize, map: &Affine) -> Result<(), Fault> {
        let meshes = &self.document.meshes;
        let entry = meshes.get(index);
        let entry = entry.ok_or_else(|| {
            Fault::corrupt(format!("it refers to mesh {index} of {}", meshes.len()))
        })?;
        for primitive in &entry.primitives {
            let mode = primitive.mode.unwrap_or(4);
            let Some(position) = primitive.attributes.position else { continue };
            if mode < 4 {
                continue; // Points and lines.
            }
            if let Some(Value::Object(used)) = &primitive.extensions
                && used.contains_key("KHR_draco_mesh_compression")
            {
                return Err(Fault::Feature("Draco compression".to_owned()));
            }
            let views = &self.document.buffer_views;
            let mut vertices = accessor::positions(self.accessor(position)?, views, &self.buffers)?;
            let indices = match primitive.indices {
                Some(k) => accessor::indices(self.accessor(k)?, views, &self.buffers)?,
                None => (0..vertices.len() as u32).collect(),
            };
            if let Some(bad) = indices.iter().find(|k| **k as usize >= vertices.len()) {
                let n = vertices.len();
                return Err(Fault::corrupt(format!("a triangle has corner {bad} of {n} vertices")));
            }
            let reflected = determinant(map) < 0.0;
            for vertex in &mut vertices {
                *vertex = volume::apply(map, vertex.map(f64::from)).map(|v| v as f32);
            }
            if vertices.iter().flatten().any(|v| !v.is_finite()) {
                return Err(Fault::corrupt("a transform takes vertices to infinity"));
            }
            let first = self.mesh.vertices.len();
            let triangles = triangles(mode, &indices, reflected)?;
            let total = (first + vertices.len()) as u64 * 12
                + (self.mesh.triangles.len() + triangles.len()) as u64 * 12;
            if total > self.limit_bytes || first + vertices.len() > u32::MAX as usize {
                return Err(Fault::TooLarge { needed: total, limit: self.limit_bytes });
            }
            let moved = triangles.into_iter().map(|t| t.map(|k| k + first as u32));
            self.mesh.vertices.extend(vertices);
            self.mesh.triangles.extend(moved);
        }
        Ok(())
    }

    fn accessor(&self, index: usize) -> Result<&Accessor, Fault> {
        let list = &self.document.accessors;
        list.get(index).ok_or_else(|| {
            Fault::corrupt(format!("it refers to accessor {index} of {}", list.len()))
        })
    }
}

/// Lists (4), strips (5) and fans (6) as triangles with their front where the format says.
fn triangles(mode: u32, indices: &[u32], reflected: bool) -> Result<Vec<[u32; 3]>, Fault> {
    let mut out: Vec<[u32; 3]> = match mode {
        4 if !indices.len().is_multiple_of(3) => {
            return Err(Fault::corrupt(format!("{} corners of triangles", indices.len())));
        }
        4 => indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        5 => {
            let turned = |(k, t): (usize, &[u32])| match k % 2 {
                0 => [t[0], t[1], t[2]],
                _ => [t[1], t[0], t[2]],
            };
            indices.windows(3).enumerate().map(turned).collect()
        }
        6 => indices.windows(2).skip(1).map(|t| [t[0], t[1], indices[0]]).collect(),
        other => return Err(Fault::corrupt(format!("primitives of mode {other}"))),
    };
    if reflected {
        out.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(out)
}

/// The map of a node: its matrix (columns), or scale, then rotation, then translation.
fn transform(node: &Node) -> Result<Affine, Fault> {
    let map: Affine = match &node.matrix {
        Some(m) => std::array::from_fn(|r| std::array::from_fn(|c| m[4 * c + r])),
        None => {
            let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
            let (scale, offset) =
                (node.scale.unwrap_or([1.0; 3]), node.translation.unwrap_or([0.0; 3]));
            let rows = [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ];
            std::array::from_fn(|r| {
                std::array::from_fn(|c| if c == 3 { offset[r] } else { rows[r][c] * scale[c] })
            })
        }
    };
    match map.iter().flatten().all(|v| v.is_finite()) {
        true => Ok(map),
        false => Err(Fault::corrupt("a node's transform is not finite")),
    }
}
