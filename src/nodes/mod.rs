//! One file a kind of node.

use crate::engine::node::NodeKind;

mod check;
mod clean;
mod command;
mod decimate;
mod depth_mesh;
mod descriptors;
mod download;
mod eigs;
mod fmap;
mod joint_error;
mod landmarks;
mod laplacian;
mod load;
mod load_depth;
mod make_body;
mod normalize;
mod nrr;
mod pick_frame;
mod plot;
mod point_cloud;
mod python;
mod registration_error;
mod regressor;
mod render_depth;
mod rig;
mod segment;
mod snapshot;
mod spectral_regressor;
mod subdivide;
mod synthesize;
mod table;
mod table_file;
mod transfer;
mod transfer_weights;
mod zoomout;

/// Every kind. Keep sorted by name.
pub static ALL: &[NodeKind] = &[
    NodeKind::of::<check::Check>(),
    NodeKind::of::<clean::Clean>(),
    NodeKind::open::<command::Command>(),
    NodeKind::of::<decimate::Decimate>(),
    NodeKind::of::<depth_mesh::DepthMesh>(),
    NodeKind::of::<descriptors::DescriptorsNode>(),
    NodeKind::of::<download::Download>(),
    NodeKind::of::<eigs::Eigs>(),
    NodeKind::of::<fmap::Fmap>(),
    NodeKind::of::<joint_error::JointError>(),
    NodeKind::of::<landmarks::LandmarksNode>(),
    NodeKind::of::<laplacian::Laplacian>(),
    NodeKind::of::<load::Load>(),
    NodeKind::of::<load_depth::LoadDepth>(),
    NodeKind::of::<make_body::MakeBody>(),
    NodeKind::of::<normalize::Normalize>(),
    NodeKind::of::<nrr::Nrr>(),
    NodeKind::of::<pick_frame::PickFrame>(),
    NodeKind::of::<plot::Plot>(),
    NodeKind::of::<point_cloud::PointCloud>(),
    NodeKind::open_labelled::<python::Python>(),
    NodeKind::of::<registration_error::RegistrationError>(),
    NodeKind::of::<regressor::RegressorNode>(),
    NodeKind::of::<render_depth::RenderDepth>(),
    NodeKind::of::<rig::RigNode>(),
    NodeKind::of::<segment::Segment>(),
    NodeKind::of::<snapshot::Snapshot>(),
    NodeKind::of::<spectral_regressor::SpectralRegressorNode>(),
    NodeKind::of::<subdivide::Subdivide>(),
    NodeKind::of::<synthesize::Synthesize>(),
    NodeKind::of::<table::TableNode>(),
    NodeKind::of::<table_file::TableFile>(),
    NodeKind::of::<transfer::Transfer>(),
    NodeKind::of::<transfer_weights::TransferWeights>(),
    NodeKind::of::<zoomout::ZoomOut>(),
];
