"""Tables, figures, pages and result folders, whatever they show."""
