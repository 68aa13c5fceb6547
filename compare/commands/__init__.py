"""The subcommands of `graphslam`, one file each: flags are the fields, `execute` does the work.

Nothing heavy is imported before `execute`.
"""
