//! The network: one LSTM layer with a linear head, all parameters in one flat vector, forward and backward beside each other.
//!
//! Matrices are column-major with one column per *row of work* (a window at some step), so that a window's values are
//! contiguous; weights are laid out as `torch.nn.LSTMCell` lays them out (gates in the order input, forget, cell, output).

mod activation;
mod buffer;
mod carried;
mod dispatch;
mod encode;
mod gates;
mod init;
mod lanes;
mod layout;
mod network;
mod overlap;
mod packed;
mod passes;
mod plan;
mod product;
mod real;
mod squares;
mod windows;

pub use carried::Carried;
pub use dispatch::{kernel_name, vectorised};
pub use encode::{Encoder, EncoderBuffers, EncoderState, OverlappingWindows};
pub use init::initial_weights;
pub use layout::{INPUTS, Layout};
pub use network::Network;
pub use overlap::Overlap;
pub use passes::Passes;
pub use product::{Strided, columns, product, rows};
pub use real::Real;
pub use squares::Magnitude;
pub use windows::Windows;
