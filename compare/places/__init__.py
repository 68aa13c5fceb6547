"""A building as a map of corridors: places, lamps as tags on them, ways in words, where one is.

After Bellini, Panzieri and Pascucci: an augmented topological map.
"""
