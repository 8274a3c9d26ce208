"""Tables, figures, pages and the folders they go into."""
