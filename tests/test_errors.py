import pickle

from sextant.data.source import MissingDataError


def test_a_mistake_survives_the_way_back_from_a_worker_process():
    error = pickle.loads(pickle.dumps(MissingDataError("no such folder", "make one")))
    assert isinstance(error, MissingDataError)
    assert (error.problem, error.fix, str(error)) == ("no such folder", "make one", "no such folder\nmake one")
