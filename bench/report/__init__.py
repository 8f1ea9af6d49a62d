"""``bench report``: one self-contained page with every figure, drawn from records alone."""
