"""Two maps of straight lines: the motions that lay one on the other, and whether they agree.

`line_map.LineMap` is the input, `alignment.find_alignments` the search, `ambiguity.ambiguity` says
how sure its first answer is, and `chi2.same_map` tests the differences that are left. Nothing is
imported here, so that the command line can read `config` without importing what it is for.
"""
