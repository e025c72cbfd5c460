//! A prepared transfer as bytes.
//!
//! ```text
//! magic, byte order, format        16 + 4 + 4 bytes
//! key                              32 bytes: what it was solved for
//! SHA-256 of what follows          32 bytes
//! small parts as JSON, then arrays, each with its length before it
//! ```
//!
//! Displacements are kept in `f64`: a garment carried by a stored field is the same to the
//! last bit. A cell takes 4 bytes (its place in the box around all cells, and its kind),
//! its nodes 24 each. Whatever does not fit together is no transfer: [`decode`] says `None`.

use std::sync::OnceLock;

use bytemuck::{Pod, cast_slice, pod_collect_to_vec};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::Params;
use super::align::Motion;
use super::closing::Closing;
use super::domain::{Coordinates, Domain, Kind, Lattice};
use super::field::Field;
use super::gap::Gap;
use super::prepared::{Course, Flow, Prepared, Skin, Step};
use crate::model::Vec3;

const MAGIC: &[u8; 16] = b"dressform field\n";
/// Reads differently on a machine of the other byte order.
const BYTE_ORDER: u32 = 0x0102_0304;
/// Of the file; grows with every change of its layout.
const FORMAT: u32 = 4;
const HEAD: usize = 16 + 4 + 4 + 32 + 32;
/// Set in a packed cell of kind [`Kind::Open`].
const OPEN: u32 = 1 << 31;

/// What a transfer was solved for; also its name in a cache.
pub(super) type Key = [u8; 32];

#[derive(Serialize, Deserialize)]
struct Small {
    motion: Motion,
    reach: f64,
    course: Course,
    body_gap: Gap,
    body_converged: bool,
    steps: Vec<Grids>,
    closings: usize,
}

/// The grids of a step.
#[derive(Serialize, Deserialize)]
struct Grids {
    field: Grid,
    fine: Option<Grid>,
}

/// A lattice and the box around its cells.
#[derive(Serialize, Deserialize)]
struct Grid {
    lattice: Lattice,
    lo: Coordinates,
    dims: [u32; 3],
}

/// The bytes of a transfer that was solved for `key`.
pub(super) fn encode(prepared: &Prepared, key: &Key) -> Vec<u8> {
    let small = Small {
        motion: prepared.flow.motion,
        reach: prepared.flow.reach,
        course: prepared.course.clone(),
        body_gap: prepared.body_gap,
        body_converged: prepared.body_converged,
        closings: prepared.flow.closings.len(),
        steps: prepared.flow.steps.iter().map(grids).collect(),
    };
    let mut out = vec![0; HEAD];
    put(&mut out, &serde_json::to_vec(&small).expect("plain numbers and names"));
    put(&mut out, cast_slice::<[u32; 3], u8>(&prepared.skin.triangles));
    put(&mut out, cast_slice(&prepared.skin.of_body));
    put(&mut out, cast_slice(&prepared.areas));
    for points in [&prepared.source_skin, &prepared.target_skin, &prepared.body] {
        put(&mut out, cast_slice(&flat(points)));
    }
    for step in &prepared.flow.steps {
        put(&mut out, cast_slice(&flat(&step.skin)));
        for field in [Some(&step.field), step.fine.as_ref()].into_iter().flatten() {
            put(&mut out, cast_slice(&cells(&field.domain, &Grid::of(&field.domain))));
            put(&mut out, cast_slice(&flat(&field.displacement)));
        }
    }
    for closing in &prepared.flow.closings {
        put(&mut out, cast_slice(&flat(&closing.places)));
        put(&mut out, cast_slice(&flat(&closing.missing)));
        put(&mut out, cast_slice(&closing.areas));
    }
    let digest = Sha256::digest(&out[HEAD..]);
    let head = [&MAGIC[..], &BYTE_ORDER.to_ne_bytes(), &FORMAT.to_ne_bytes(), key, &digest].concat();
    out[..HEAD].copy_from_slice(&head);
    out
}

/// The transfer that [`encode`] wrote for `key`; `None` for any other bytes.
pub(super) fn decode(bytes: &[u8], key: &Key, params: &Params) -> Option<Prepared> {
    let head = bytes.get(..HEAD)?;
    let known = [&MAGIC[..], &BYTE_ORDER.to_ne_bytes(), &FORMAT.to_ne_bytes(), key].concat();
    if head[..HEAD - 32] != known || head[HEAD - 32..] != *Sha256::digest(&bytes[HEAD..]) {
        return None;
    }
    let mut rest = &bytes[HEAD..];
    let small: Small = serde_json::from_slice(take(&mut rest)?).ok()?;
    let skin = Skin { triangles: array(&mut rest)?, of_body: array(&mut rest)? };
    let areas = array(&mut rest)?;
    let (source_skin, target_skin, body) = (points(&mut rest)?, points(&mut rest)?, points(&mut rest)?);
    let mut steps = Vec::new();
    for grids in small.steps {
        let skin = points(&mut rest)?;
        let coarse = field(&grids.field, &mut rest)?;
        let fine = match grids.fine {
            Some(grid) => Some(field(&grid, &mut rest)?),
            None => None,
        };
        steps.push(Step::stored(coarse, fine, skin));
    }
    let mut closings = Vec::new();
    for _ in 0..small.closings {
        closings.push(Closing::new(points(&mut rest)?, points(&mut rest)?, array(&mut rest)?));
    }
    let flow = Flow { params: params.clone(), motion: small.motion, reach: small.reach, steps, closings };
    Some(Prepared {
        flow,
        skin,
        source_skin,
        target_skin,
        areas,
        course: small.course,
        body,
        body_gap: small.body_gap,
        body_converged: small.body_converged,
        target_surface: OnceLock::new(),
    })
}

fn grids(step: &Step) -> Grids {
    let fine = step.fine.as_ref().map(|fine| Grid::of(&fine.domain));
    Grids { field: Grid::of(&step.field.domain), fine }
}

impl Grid {
    fn of(domain: &Domain) -> Grid {
        let (mut lo, mut hi) = ([i32::MAX; 3], [i32::MIN; 3]);
        for cell in &domain.cells {
            for d in 0..3 {
                lo[d] = lo[d].min(cell[d]);
                hi[d] = hi[d].max(cell[d]);
            }
        }
        let dims = std::array::from_fn(|d| (i64::from(hi[d]) - i64::from(lo[d]) + 1).max(0) as u32);
        Grid { lattice: domain.lattice, lo, dims }
    }
}

fn cells(domain: &Domain, grid: &Grid) -> Vec<u32> {
    let packed = domain.cells.iter().zip(&domain.kinds).map(|(cell, kind)| {
        let at: [u32; 3] = std::array::from_fn(|d| (cell[d] - grid.lo[d]) as u32);
        let slot = (at[0] * grid.dims[1] + at[1]) * grid.dims[2] + at[2]; // domains hold less than 2^27
        match kind {
            Kind::Open => slot | OPEN,
            Kind::Deep => slot,
        }
    });
    packed.collect()
}

fn field(grid: &Grid, rest: &mut &[u8]) -> Option<Field> {
    let domain = unpack(grid, &array(rest)?)?;
    let displacement = points(rest)?;
    (displacement.len() == domain.nodes.len()).then_some(Field { domain, displacement })
}

fn unpack(grid: &Grid, packed: &[u32]) -> Option<Domain> {
    let [_, ny, nz] = grid.dims;
    if ny == 0 || nz == 0 {
        return None;
    }
    let cell = |packed: &u32| {
        let slot = packed & !OPEN;
        let at = [slot / nz / ny, slot / nz % ny, slot % nz];
        let kind = if packed & OPEN == 0 { Kind::Deep } else { Kind::Open };
        (std::array::from_fn(|d| grid.lo[d] + at[d] as i32), kind)
    };
    Domain::new(grid.lattice, packed.iter().map(cell).collect()).ok()
}

fn flat(points: &[Vec3]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

fn put(out: &mut Vec<u8>, bytes: &[u8]) {
    out.extend((bytes.len() as u64).to_ne_bytes());
    out.extend(bytes);
}

fn take<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let (length, after) = rest.split_first_chunk::<8>()?;
    let (found, after) = after.split_at_checked(u64::from_ne_bytes(*length).try_into().ok()?)?;
    *rest = after;
    Some(found)
}

fn array<T: Pod>(rest: &mut &[u8]) -> Option<Vec<T>> {
    let bytes = take(rest)?;
    (bytes.len() % size_of::<T>() == 0).then(|| pod_collect_to_vec(bytes))
}

fn points(rest: &mut &[u8]) -> Option<Vec<Vec3>> {
    Some(array::<[f64; 3]>(rest)?.into_iter().map(Vec3::from).collect())
}
