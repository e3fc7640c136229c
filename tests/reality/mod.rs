//! Calibration against presses: made by the simulator itself, and real ones where `GELSIM_REAL_DATA` names a folder of
//! them.

mod detect;
mod judge;
mod page;
mod real;
mod sensors;
mod shapes;
mod synthetic;
