"""From a recorded flight's file, as it comes, to clean segments and remarks on what was wrong with it.

`formats` reads columns and stamps, `mapping` makes channels of columns, `stamps` orders the clocks, `plausibility`
remarks on what looks wrong, `segments` cuts records at gaps; `open` is the door to all of it. (For logs of our own that
are to come back bit for bit there is `gtmbench.files.logs`.)
"""
