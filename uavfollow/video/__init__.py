"""Pictures in (files, folders, cameras) and out (overlay video)."""
