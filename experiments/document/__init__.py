"""Documents: tables, figures, pages and the files that they become, whatever they show."""
