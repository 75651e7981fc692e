"""The verdict on the paper's claims: readings, one factor changed at a time, judged with intervals (docs/study.md)."""
