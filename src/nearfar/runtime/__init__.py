"""Running well: workers, a cluster, progress, logs, timing and optional packages."""
