//! Import of Taxim's calibrations: archives of arrays, a made-up folder, its colours, and the package `taxim` itself.
//!
//! `package` compares with pictures that `tests/python/test_taxim.py` made by the package; the folder they are in is
//! named by `GELSIM_TAXIM`.

mod colours;
mod folder;
mod import;
mod npz;
mod package;
