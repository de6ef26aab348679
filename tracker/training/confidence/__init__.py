"""Fitting the confidence: samples from sequences with truth, a regression, its figures on unseen sequences."""
