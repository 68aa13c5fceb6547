"""What the papers print of their experiments: numbers, tables and figures, each with its place."""

from compare.printed.paper import PrintedPaper, PrintedTable, PrintedValue, printed_paper

__all__ = ["PrintedPaper", "PrintedTable", "PrintedValue", "printed_paper"]
