"""Folders and files on a disk or in object storage, and what is kept there."""
