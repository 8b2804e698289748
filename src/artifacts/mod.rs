//! The kernels' types made storable: one file a type.

mod basis;
mod clip;
mod correspondences;
mod curve_skeleton;
mod depth_video;
mod descriptors;
mod figure;
mod files;
mod functional_map;
mod image;
mod landmarks;
mod matrix;
mod mesh;
mod mesh_sequence;
mod npz;
mod operator;
mod point_map;
mod regressor;
mod rig;
mod segment_map;
mod skeleton;
mod skeleton_match;
mod sparse;
mod spectral_regressor;
mod table;
mod text;
mod weights;

use crate::engine::{
    artifact::{ArtifactKind, Bytes, Decoder, Dtype, EncodedArtifact, Format},
    library::CommonFormat,
};
use crate::kernels::{
    self,
    io::zip::{NpyArray, write_npz},
};

pub use rig::Rig;

/// Every type of artifact. Keep sorted by the types' names.
pub static ALL: &[ArtifactKind] = &[
    ArtifactKind::of::<kernels::spectral::basis::Basis>(),
    ArtifactKind::of::<kernels::rigs::clip::Clip>(),
    ArtifactKind::of::<kernels::maps::correspondences::Correspondences>(),
    ArtifactKind::of::<kernels::curve_skeletons::curve_skeleton::CurveSkeleton>(),
    ArtifactKind::of::<kernels::sensors::depth::DepthVideo>(),
    ArtifactKind::of::<kernels::spectral::descriptors::Descriptors>(),
    ArtifactKind::of::<kernels::pictures::figure::Figure>(),
    ArtifactKind::of::<kernels::files::FileSet>(),
    ArtifactKind::of::<kernels::maps::functional_map::FunctionalMap>(),
    ArtifactKind::of::<kernels::image::Image>(),
    ArtifactKind::of::<kernels::geometry::landmarks::Landmarks>(),
    ArtifactKind::of::<kernels::geometry::mesh::TriMesh>(),
    ArtifactKind::of::<kernels::geometry::mesh_sequence::MeshSequence>(),
    ArtifactKind::of::<kernels::spectral::operator::Operator>(),
    ArtifactKind::of::<kernels::maps::functional_map::PointMap>(),
    ArtifactKind::of::<kernels::transfer::regressor::Regressor>(),
    ArtifactKind::of::<Rig>(),
    ArtifactKind::of::<kernels::rigs::segment_map::SegmentMap>(),
    ArtifactKind::of::<kernels::rigs::skeleton::Skeleton>(),
    ArtifactKind::of::<kernels::matching::skeleton_match::SkeletonMatch>(),
    ArtifactKind::of::<kernels::transfer::regressor::SpectralRegressor>(),
    ArtifactKind::of::<kernels::table::Table>(),
    ArtifactKind::of::<kernels::text::Text>(),
    ArtifactKind::of::<kernels::rigs::weights::SkinWeights>(),
];

/// The type of this name.
pub fn kind(name: &str) -> Option<&'static ArtifactKind> {
    let index = ALL.binary_search_by(|it| it.ty.name.cmp(name)).ok()?;
    Some(&ALL[index])
}

/// Extensions of files with the arrays of any artifact that [`import`] reads.
pub const COMMON_IMPORTS: [&str; 2] = ["npz", "safetensors"];

/// Reads an artifact of a type from a file that another program wrote, by its extension: one of
/// [`COMMON_IMPORTS`], or one of the type's own. Returns the artifact and the bytes to store.
///
/// # Errors
/// If the file does not hold an artifact of this type.
pub fn import(
    kind: &ArtifactKind,
    extension: &str,
    bytes: Bytes,
) -> Result<EncodedArtifact, String> {
    match extension {
        "npz" => kind.import("safetensors", npz::tensors_of_npz(&bytes)?.into()),
        _ => kind.import(extension, bytes),
    }
}

/// Formats that hold the arrays of any artifact.
pub static COMMON_FORMATS: &[CommonFormat] = &[
    CommonFormat {
        format: Format { extension: "npz", doc: "All arrays, for `numpy.load`; without texts." },
        write: |_, decoder| Ok(npz(decoder)),
    },
    CommonFormat {
        format: Format { extension: "safetensors", doc: "All arrays, as they are stored." },
        write: |bytes, _| Ok(bytes.to_vec()),
    },
];

fn npz(decoder: &Decoder<'_>) -> Vec<u8> {
    let arrays: Vec<NpyArray<'_>> = decoder
        .arrays()
        .map(|(name, it)| {
            let dtype = match it.dtype {
                Dtype::F64 => "<f8",
                Dtype::I64 => "<i8",
                Dtype::U64 => "<u8",
                Dtype::F32 => "<f4",
                Dtype::U32 => "<u4",
                Dtype::U16 => "<u2",
                Dtype::U8 => "|u1",
            };
            NpyArray { name, dtype, shape: &it.shape, bytes: &it.bytes }
        })
        .collect();
    write_npz(&arrays)
}
