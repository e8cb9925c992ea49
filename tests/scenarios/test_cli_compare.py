"""`excite score`, `compare` and `orders`: models judged; and films of flights."""

import numpy as np
import pytest
from command_line import ROLES, excite, identify, refused, samples, strict, write

# score, compare ---------------------------------------------------------------------------------------------------------


def test_score_against_the_plants_truth(flight, tmp_path):
    model = tmp_path / "m.json"
    view = ("--view", "attitude", "--decimate", "5")
    assert excite("identify", flight / "flight.npz", *view, "--method", "arx", "--order", "3", "-o", model)[0] == 0
    code, out, _ = excite("score", model, flight / "flight.npz", *view, "--truth", "auto", "--json")
    values = strict(out)["values"]
    assert code == 0 and values["fit_one_step"] > 50 and 0 < values["frf_error_h2"] < 10
    assert (values["poles_missing"], values["poles_surplus"]) == (2, 0)  # three lags of three outputs against 11 states
    assert "pole_error_max" not in strict(excite("score", model, flight / "flight.npz", *view, "--json")[1])["values"]
    code, out, _ = excite("score", model, flight / "flight.npz", *view, "--truth", "auto")
    assert code == 0 and "frf_error_h2" in out
    assert "dt 0.02 s, the record 0.004 s" in refused("score", model, flight / "flight.npz", "--view", "attitude")
    roles = ("--inputs", "roll_ref", "--outputs", "roll")
    assert "drop --inputs" in refused("score", model, flight / "flight.npz", *roles, "--truth", "auto")


def test_score_refusals(data, tmp_path):
    model = tmp_path / "m.json"
    assert excite(*identify(data, "--order", "2", "-o", model))[0] == 0
    assert "not a recording" in refused("score", model, data, *ROLES, "--truth", "auto")
    assert "the record 0.2 s" in refused("score", model, data, *ROLES[:4], "--dt", "0.2")
    wide = write(tmp_path / "wide.csv", np.hstack([samples(), samples(seed=1)]))
    assert "1 outputs, the record 2" in refused(
        "score", model, wide, "--inputs", "0", "--outputs", "1,3", "--dt", "0.1"
    )
    broken = tmp_path / "broken.json"
    texts = {
        "": "not valid JSON",
        "[1]": "a JSON list, not a model",
        "{}": "key 'kind' is missing",
        '{"kind": "firr"}': "did you mean 'fir'",
        '{"kind": "fir"}': "key 'h' is missing",
    }
    for text, message in texts.items():
        broken.write_text(text)
        got = refused("score", broken, data, *ROLES)
        assert message in got and str(broken) in got
    broken.write_text(model.read_text()[:400])
    assert "not valid JSON" in refused("score", broken, data, *ROLES)
    assert "cannot be read" in refused("score", tmp_path / "absent.json", data, *ROLES)
    assert "cannot be read" in refused("score", tmp_path, data, *ROLES)


def test_compare_ranks_by_validation_fit_and_writes_the_models(data, tmp_path):
    folder = tmp_path / "out"
    argv = ("compare", data, *ROLES, "--methods", "arx,po_moesp", "--orders", "1,3,500", "-o", folder)
    code, out, err = excite(*argv, "--json")
    report = strict(out)
    fits = [row["values"]["fit_simulation"] for row in report["rows"] if row["reason"] is None]
    assert code == 0 and len(fits) == 4 and fits == sorted(fits, reverse=True)
    failed = [row for row in report["rows"] if row["reason"] is not None]
    assert [row["order"] for row in failed] == [500, 500] and all("largest possible" in row["reason"] for row in failed)
    models = {f"{method}-n{order}.json" for method in ("arx", "po_moesp") for order in (1, 3)}
    kept = {"index", "trials", ".lock"}  # by which the same command goes on where it was
    assert {p.name for p in folder.iterdir()} - kept == {"comparison.json"} | models
    assert strict((folder / "comparison.json").read_text()) == report
    assert "identifying" in err and "identifying" not in out
    code, out, _ = excite(*argv)
    assert code == 0 and "po_moesp n=500 failed" in out and "largest possible" in out


@pytest.mark.parametrize("orders", ["a", "", "2:", "5:2", "0:3", "2,,3", "-1", "1:2:3", "2.5", "1:1000000000000"])
def test_orders_that_make_no_sense(orders, data, tmp_path):
    message = refused("compare", data, *ROLES, "--methods", "arx", "--orders", orders, "-o", tmp_path / "out")
    assert f"--orders {orders}" in message and not (tmp_path / "out").exists()


def test_compare_that_cannot_work_leaves_no_folder(data, tmp_path):
    few = write(tmp_path / "few.csv", samples(2))
    argv, out = ("--methods", "arx", *ROLES, "-o"), tmp_path / "out"
    assert "few.csv: 2 samples" in refused("compare", few, *argv, out)
    assert "absent.csv" in refused("compare", data, "--validation", tmp_path / "absent.csv", *argv, out)
    assert "none of arx has this setting" in refused("compare", data, "--set", "block_row=3", *argv, out)
    assert "is no folder" in refused("compare", data, *argv, data)
    assert "is no folder" in refused("compare", data, *argv, "")
    assert not out.exists()
    code, text, _ = excite("compare", data, *argv, out, "--orders", "900")
    assert code == 2 and "largest possible" in text  # a table of reasons, but no model


# excite orders ----------------------------------------------------------------------------------------------------------


def test_orders_says_what_speaks_for_each(data, tmp_path):
    asked = ("orders", data, *ROLES, "--method", "po_moesp", "--orders", "1:6")
    code, out, _ = excite(*asked, "--plot", tmp_path / "o.png", "--json")
    table = strict(out)
    assert code == 0 and [row["order"] for row in table["orders"]] == [1, 2, 3, 4, 5, 6]
    assert set(table["chosen"]) == {"gap", "aic", "aicc", "bic"} and table["chosen"]["bic"] >= 2
    assert (tmp_path / "o.png").stat().st_size > 10_000
    text = excite(*asked)[1]
    assert f"BIC: {table['chosen']['bic']}" in text and text.splitlines()[0].split()[0] == "order"


def test_orders_that_cannot_be_fitted_are_refused_or_listed(data):
    assert "no order of 400 could be fitted: po_moesp: order 400 is above the largest" in refused(
        "orders", data, *ROLES, "--method", "po_moesp", "--orders", "400"
    )
    out = excite("orders", data, *ROLES, "--method", "po_moesp", "--orders", "2,400")[1]
    assert "largest possible" in out and "best order by singular-value gap: 2" in out


def test_only_flights_are_filmed_and_into_gif_files(flight, tmp_path):
    argv = ("simulate", "quadrotor", "--input", flight / "played.csv", "-o", tmp_path / "f.npz")
    assert "ends in .gif" in refused(*argv, "--clip", tmp_path / "f.mp4")
    assert "only flights of the quadrotor" in refused(
        *(a if a != "quadrotor" else "goland" for a in argv), "--clip", "f.gif"
    )
    assert not list(tmp_path.iterdir())
