"""Pages for the browser: scenes, values and equations as data of an HTML file."""
