//! One file a kind of node.

use crate::engine::node::NodeKind;

mod clean;
mod decimate;
mod download;
mod eigs;
mod laplacian;
mod load;
mod make_body;
mod normalize;
mod rig;
mod snapshot;
mod subdivide;
mod synthesize;
mod table;
/// Every kind. Keep sorted by name.
pub static ALL: &[NodeKind] = &[
    NodeKind::of::<clean::Clean>(),
    NodeKind::of::<decimate::Decimate>(),
    NodeKind::of::<download::Download>(),
    NodeKind::of::<eigs::Eigs>(),
    NodeKind::of::<laplacian::Laplacian>(),
    NodeKind::of::<load::Load>(),
    NodeKind::of::<make_body::MakeBody>(),
    NodeKind::of::<normalize::Normalize>(),
    NodeKind::of::<rig::RigNode>(),
    NodeKind::of::<snapshot::Snapshot>(),
    NodeKind::of::<subdivide::Subdivide>(),
    NodeKind::of::<synthesize::Synthesize>(),
    NodeKind::of::<table::TableNode>(),
mod descriptors;
mod fmap;
mod joint_error;
mod landmarks;
mod regressor;
mod spectral_regressor;
mod transfer;
mod transfer_weights;
mod zoomout;
    NodeKind::of::<descriptors::DescriptorsNode>(),
    NodeKind::of::<fmap::Fmap>(),
    NodeKind::of::<joint_error::JointError>(),
    NodeKind::of::<landmarks::LandmarksNode>(),
    NodeKind::of::<regressor::RegressorNode>(),
    NodeKind::of::<spectral_regressor::SpectralRegressorNode>(),
    NodeKind::of::<transfer::Transfer>(),
    NodeKind::of::<transfer_weights::TransferWeights>(),
    NodeKind::of::<zoomout::ZoomOut>(),
];
