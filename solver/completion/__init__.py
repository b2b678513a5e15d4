"""From a method's solution to the finished map: filling, deviation, reasons for unknown pixels."""
