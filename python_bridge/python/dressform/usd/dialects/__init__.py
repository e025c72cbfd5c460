"""Other tools' names for rest shapes, panels, seams and fabrics, a module for each.

The names still move (AOUSD's proposal is open), so that each stands in one place only.
"""
