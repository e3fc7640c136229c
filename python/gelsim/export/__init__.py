"""Copies of datasets in other formats: the command `gelsim-export`. docs/how-to/export.md says what each holds."""
