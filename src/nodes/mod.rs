//! One file a kind of node.

use crate::engine::node::NodeKind;

mod animate;
mod check;
mod clean;
mod command;
mod compare_regressors;
mod contract;
mod correspondences;
mod decimate;
mod deformation_error;
mod degrade;
mod depth_mesh;
mod descriptors;
mod direction_error;
mod download;
mod eigs;
mod embed;
mod farm_map;
mod fit_surface;
mod fmap;
mod icp_refine;
mod joint_detection_error;
mod joint_error;
mod joints;
mod landmark_error;
mod landmarks;
mod landmarks_auto;
mod laplacian;
mod load;
mod load_depth;
mod load_motion;
mod load_skeleton;
mod make_body;
mod map_quality;
mod match_skeletons;
mod motion_error;
mod motion_skeleton;
mod normalize;
mod nrr;
mod pick_frame;
mod plot;
mod point_cloud;
mod point_map;
mod pose;
mod python;
mod registration_error;
mod regressor;
mod regressor_image;
mod remesh;
mod render_depth;
mod resample_clip;
mod resolve_penetration;
mod retarget;
mod rig;
mod rooted_skeleton;
mod scan;
mod segment;
mod segment_map;
mod segments_by_name;
mod simplify_skeleton;
mod skeleton_error;
mod skeleton_texture;
mod skeletonize;
mod skeletonize_kmeans;
mod skeletonize_le;
mod skeletonize_zhang;
mod skin_weights;
mod snapshot;
mod spectral_regressor;
mod ssdr;
mod subdivide;
mod synthesize;
mod table;
mod table_file;
mod transfer;
mod transfer_animation;
mod transfer_weights;
mod union_skeleton;
mod weights_error;
mod zoomout;

/// Every kind. Keep sorted by name.
pub static ALL: &[NodeKind] = &[
    NodeKind::of::<animate::Animate>(),
    NodeKind::of::<check::Check>(),
    NodeKind::of::<clean::Clean>(),
    NodeKind::open::<command::Command>(),
    NodeKind::of::<compare_regressors::CompareRegressors>(),
    NodeKind::of::<contract::Contract>(),
    NodeKind::of::<correspondences::CorrespondencesNode>(),
    NodeKind::of::<decimate::Decimate>(),
    NodeKind::of::<deformation_error::DeformationErrorNode>(),
    NodeKind::of::<degrade::Degrade>(),
    NodeKind::of::<depth_mesh::DepthMesh>(),
    NodeKind::of::<descriptors::DescriptorsNode>(),
    NodeKind::of::<direction_error::DirectionErrorNode>(),
    NodeKind::of::<download::Download>(),
    NodeKind::of::<eigs::Eigs>(),
    NodeKind::of::<embed::EmbedNode>(),
    NodeKind::of::<farm_map::FarmMap>(),
    NodeKind::of::<fit_surface::FitSurfaceNode>(),
    NodeKind::of::<fmap::Fmap>(),
    NodeKind::of::<icp_refine::IcpRefine>(),
    NodeKind::of::<joint_detection_error::JointDetectionError>(),
    NodeKind::of::<joint_error::JointError>(),
    NodeKind::of::<joints::Joints>(),
    NodeKind::of::<landmark_error::LandmarkError>(),
    NodeKind::of::<landmarks::LandmarksNode>(),
    NodeKind::of::<landmarks_auto::LandmarksAuto>(),
    NodeKind::of::<laplacian::Laplacian>(),
    NodeKind::of::<load::Load>(),
    NodeKind::of::<load_depth::LoadDepth>(),
    NodeKind::of::<load_motion::LoadMotion>(),
    NodeKind::of::<load_skeleton::LoadSkeleton>(),
    NodeKind::of::<make_body::MakeBody>(),
    NodeKind::of::<map_quality::MapQuality>(),
    NodeKind::of::<match_skeletons::MatchSkeletons>(),
    NodeKind::of::<motion_error::MotionErrorNode>(),
    NodeKind::of::<motion_skeleton::MotionSkeletonNode>(),
    NodeKind::of::<normalize::Normalize>(),
    NodeKind::of::<nrr::Nrr>(),
    NodeKind::of::<pick_frame::PickFrame>(),
    NodeKind::of::<plot::Plot>(),
    NodeKind::of::<point_cloud::PointCloud>(),
    NodeKind::of::<point_map::PointMapNode>(),
    NodeKind::of::<pose::PoseNode>(),
    NodeKind::open_labelled::<python::Python>(),
    NodeKind::of::<registration_error::RegistrationError>(),
    NodeKind::of::<regressor::RegressorNode>(),
    NodeKind::of::<regressor_image::RegressorImage>(),
    NodeKind::of::<remesh::Remesh>(),
    NodeKind::of::<render_depth::RenderDepth>(),
    NodeKind::of::<resample_clip::ResampleClip>(),
    NodeKind::of::<resolve_penetration::ResolvePenetrationNode>(),
    NodeKind::of::<retarget::RetargetNode>(),
    NodeKind::of::<rig::RigNode>(),
    NodeKind::of::<rooted_skeleton::RootedSkeleton>(),
    NodeKind::of::<scan::Scan>(),
    NodeKind::of::<segment::Segment>(),
    NodeKind::of::<segment_map::SegmentMapNode>(),
    NodeKind::of::<segments_by_name::SegmentsByName>(),
    NodeKind::of::<simplify_skeleton::SimplifySkeleton>(),
    NodeKind::of::<skeleton_error::SkeletonError>(),
    NodeKind::of::<skeleton_texture::SkeletonTextureNode>(),
    NodeKind::of::<skeletonize::Skeletonize>(),
    NodeKind::of::<skeletonize_kmeans::SkeletonizeKmeans>(),
    NodeKind::of::<skeletonize_le::SkeletonizeLe>(),
    NodeKind::of::<skeletonize_zhang::SkeletonizeZhang>(),
    NodeKind::of::<skin_weights::SkinWeightsNode>(),
    NodeKind::of::<snapshot::Snapshot>(),
    NodeKind::of::<spectral_regressor::SpectralRegressorNode>(),
    NodeKind::of::<ssdr::SsdrNode>(),
    NodeKind::of::<subdivide::Subdivide>(),
    NodeKind::of::<synthesize::Synthesize>(),
    NodeKind::of::<table::TableNode>(),
    NodeKind::of::<table_file::TableFile>(),
    NodeKind::of::<transfer::Transfer>(),
    NodeKind::of::<transfer_animation::TransferAnimationNode>(),
    NodeKind::of::<transfer_weights::TransferWeights>(),
    NodeKind::of::<union_skeleton::UnionSkeleton>(),
    NodeKind::of::<weights_error::WeightsErrorNode>(),
    NodeKind::of::<zoomout::ZoomOut>(),
];
