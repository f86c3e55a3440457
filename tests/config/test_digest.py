import copy

from sextant.composing.compose import compose, to_plain
from sextant.config import digest, validate


def test_nuisances_do_not_change_the_digest():
    plain = to_plain(compose([]))
    nuisances = ["seed=5", "trainer.workers=2", "trainer.progress=false", "tracking=none", "paths.outputs=/elsewhere"]
    assert digest(to_plain(compose(nuisances))) == digest(plain)


def test_whatever_changes_the_result_changes_the_digest():
    changes = ["optimizer.lr=0.03", "backbone=lenet_b", "inhibition=twin", "trainer.threads=2", "trainer.max_epochs=3"]
    changes += ["dataset.size=32", "corruption.seed=1", "task.split_seed=1", "schedule=cosine", "init_from=x"]
    digests = {digest(to_plain(compose([change]))) for change in changes}
    assert len(digests | {digest(to_plain(compose([])))}) == len(changes) + 1


def test_the_order_of_keys_does_not_matter():
    plain = to_plain(compose([]))
    shuffled = {key: copy.deepcopy(plain[key]) for key in reversed(plain)}
    assert digest(shuffled) == digest(plain)


def test_a_group_and_its_values_written_out_are_the_same_experiment():
    assert digest(to_plain(compose(["backbone=lenet_b"]))) == digest(to_plain(compose(["backbone.variant=B"])))


def test_a_number_is_the_same_however_it_is_written():
    written = [["inhibition=push_pull", f"inhibition.scale={scale}"] for scale in ("2", "2.0", "2e0")]
    assert len({digest(validate(to_plain(compose(o))).model_dump(by_alias=True)) for o in written}) == 1


def test_a_filter_without_support_is_the_one_of_before_there_was_any():
    plain = to_plain(compose(["task=localization", "filter.support=null"]))
    older = {**plain, "filter": {key: value for key, value in plain["filter"].items() if key != "support"}}
    supported = to_plain(compose(["task=localization"]))
    digests = [digest(validate(config).model_dump(by_alias=True)) for config in (plain, older, supported)]
    assert digests[0] == digests[1] != digests[2]


def test_a_sharper_kernel_of_before_is_as_it_was_in_the_heading():
    settings = ["{length: 0.5, noise: 0.001}", "{length: 0.5, noise: 0.001, heading: 1.0}"]
    settings += ["{length: 0.5, noise: 0.001, heading: 1.6}"]
    digests = []
    for given in settings:
        plain = to_plain(compose(["task=localization", f"kernel.sharper={given}"]))
        digests.append(digest(validate(plain).model_dump(by_alias=True)))
    assert digests[0] == digests[1] != digests[2]


def test_a_last_layer_from_as_many_images_as_before_is_the_same():
    given = ["task.whitening={components: 256, shrinkage: 1.0}"]
    given += ["task.whitening.images=4000", "task.whitening.images=9000"]
    plain = [to_plain(compose(["task=place_recognition", each])) for each in given]
    digests = [digest(validate(each).model_dump(by_alias=True)) for each in plain]
    assert digests[0] == digests[1] != digests[2]
