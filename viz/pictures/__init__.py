"""Pictures and films: the overlay, the contact sheet, the plot of a comparison."""
