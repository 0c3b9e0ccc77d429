"""What the page and the figures both read out of ``panel.json``; nothing is computed or drawn."""
