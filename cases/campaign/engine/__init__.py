"""Cells of work in processes of their own, here or on a cluster; none is lost."""
