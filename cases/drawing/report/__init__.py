"""Reports of comparisons: pages of one file, Markdown, LaTeX."""
