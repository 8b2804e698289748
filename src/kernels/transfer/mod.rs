//! What functional maps carry from shape to shape: joints as sums over vertices, skin weights.

pub mod adam_regressor;
pub mod avril_regressor;
pub mod convex_regressor;
pub mod exact_regressor;
pub mod pose_regressor;
pub mod regressor;
pub mod regressor_bands;
pub mod regressor_masks;
pub mod skeleton_transfer;
pub mod transfer_weights;
