"""Formation flight behind a virtual leader (the chapter's section 5.2)."""
