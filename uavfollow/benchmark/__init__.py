"""Trackers over whole data sets: jobs, their results, scores, tables and plots."""
