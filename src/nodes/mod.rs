//! One file a kind of node.

use crate::engine::node::NodeKind;

mod descriptors;
mod fmap;
mod joint_error;
mod landmarks;
mod regressor;
mod spectral_regressor;
mod transfer;
mod transfer_weights;
mod zoomout;

/// Every kind. Keep sorted by name.
pub static ALL: &[NodeKind] = &[
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
