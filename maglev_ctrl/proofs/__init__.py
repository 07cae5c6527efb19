"""Proofs about closed loops that trust no solver: matrices of a certificate, re-checked with rounding bounds."""
