"""The local web app: see a localization, check it, annotate ground truth. Needs the extra `app`."""

PACKAGES = ("fastapi", "uvicorn", "filelock", "platformdirs", "yaml")
"""Packages of the extra `app`."""
