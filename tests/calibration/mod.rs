//! Does `gelsim calibrate` find out what a sensor does to light? The sensor is our own, so that the truth is known:
//! `sensor` is what is hidden, `recovery` what is learnt of it from good presses and from bad ones, `tables` what holds
//! for the light of any table that was learnt.

mod recovery;
mod sensor;
mod tables;
