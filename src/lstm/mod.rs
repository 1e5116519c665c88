//! The network: one LSTM layer with a linear head, all parameters in one flat vector, forward and backward beside each other.
//!
//! Weights come in one flat vector, laid out as `torch.nn.LSTMCell` lays them out (gates in the order input, forget, cell, output),
//! and are arranged once an update or once a version. Both ways of going through a network, training's and serving's, compute
//! sixteen units at a time, whose four gates lie beside each other; sums run in one order, so that bits depend neither on the
//! instruction set nor on who is computed beside.

mod activation;
mod arranged;
mod backward;
mod dispatch;
mod ends;
mod forward;
mod encode;
mod gates;
mod gradient;
mod init;
mod lanes;
mod lines;
mod layout;
mod network;
mod outer;
mod passes;
mod plan;
mod real;
mod squares;
mod tiles;
#[cfg(test)]
mod tests;
mod windows;

pub use dispatch::{kernel_name, vectorised};
pub use encode::{Encoder, EncoderBuffers, EncoderState, OverlappingWindows};
pub use init::initial_weights;
pub use layout::{INPUTS, Layout};
pub use network::Network;
pub use passes::{Gradients, Passes};
pub use real::Real;
pub use squares::Magnitude;
pub use windows::Windows;
