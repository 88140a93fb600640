"""The ground from above: carriageway, markings, surface, shadows."""
