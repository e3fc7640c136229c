"""Copies of datasets in other formats: the command `gelsim-export`. docs/formats.md says what each holds."""
