"""What a relation earns is counted in the logs that have it, without it beside with it."""

import pandas as pd

import what_relations_earn as study


def row(log, without, said=None, **more):
    fault = {"fault": "bias", "sensor": "tas", "said": said} if said else {"fault": "", "sensor": ""}
    return {"log": log, "without": without, "accused": 0, "clear_min": 0.0, "cpu_s": 0.0, **fault, **more}


def test_a_relation_is_counted_in_the_logs_that_have_it():
    rows = [
        row("a", study.ALL, clear_min=4.0),
        row("a", study.ALL, "named"),
        row("a", "field", clear_min=1.0, accused=2),
        row("a", "field", "not accused"),
        row("b", study.ALL, clear_min=8.0),
        row("b", study.ALL, "named"),
    ]
    logs, table = study.report(pd.DataFrame(rows))
    assert logs == "2 logs."
    told = [cell.strip() for cell in table.splitlines()[-1].strip("|").split("|")]
    assert told == ["field", "1", "1", "1", "0 -> 1", "0 -> 0", "0 -> 0", "2 -> 0", "1 -> 4 min", "0.0 -> 0.0 s"]
