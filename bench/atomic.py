"""Whole or absent files: `algorithms.atomic`, under the name that this layer knows it by."""

from algorithms.atomic import TEMPORARY, files_below, write_file, write_folder

__all__ = ["TEMPORARY", "files_below", "write_file", "write_folder"]
