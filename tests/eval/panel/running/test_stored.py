"""A panel whose directory is a place in an object store: sent as it is done, and resumed there."""

import obstore
import pytest
from shared_panel import assert_equal_records, ended, kill_group, started, until, words

from integ_gym.cli import main
from integ_gym.support.storage import local_copy

pytestmark = pytest.mark.slow

OWN = "shared_panel:two_processes"


def test_a_driver_is_killed_and_another_goes_on_from_what_was_sent(
    tmp_path, undisturbed, bucket, object_server, capsys
):
    store = obstore.store.from_url(bucket, client_options={"allow_http": True})

    def names():
        return {one["path"] for one in obstore.list(store).collect()}

    first = started(words(tmp_path, bucket), **object_server)
    until(lambda: [name for name in names() if name.startswith("units/train-")], first)
    refused = started(words(tmp_path, bucket), **object_server)
    assert ended(refused) == 2, "another driver works there"
    kill_group(first)
    kept = {name for name in names() if name.startswith("units/")}
    assert kept
    assert "panel.json" not in names()
    again = started(words(tmp_path, bucket, "--executor", OWN), **object_server)
    assert ended(again) == 0
    assert kept < names()
    assert not [name for name in names() if name.startswith(".")]
    with local_copy(bucket) as run:
        assert_equal_records(run, undisturbed)
        assert (run / "seal.json").exists()
    sql = "SELECT record_id, content_hash FROM records ORDER BY ALL"
    printed = []
    for where in (bucket, str(undisturbed)):
        assert main(["evidence", "query", where, sql, "--format", "csv"]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]
    assert main(["evidence", "query", bucket, "COPY records TO '/tmp/x.csv'"]) == 2
    assert main(["evidence", "query", bucket, "SELECT * FROM read_csv('/etc/passwd')"]) == 2
    assert main(["evidence", "verify", bucket, "--sample", "20"]) == 0
    assert main(["report", bucket]) == 0
    assert main(["evidence", "verify", bucket, "--depth", "sealed"]) == 0
    assert f"Page: {bucket}/report.html" in capsys.readouterr().out
