"""Segmentation networks that others have trained, as files that the estimator ``segments`` runs."""
