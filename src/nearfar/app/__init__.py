"""The local web app: see a localization, check it, annotate ground truth. Needs the extra `app`."""

PACKAGES = ("fastapi", "uvicorn", "filelock", "platformdirs", "yaml")
"""Of the extra `app`."""
