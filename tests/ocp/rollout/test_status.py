"""Every status is a sentence that says whether the answer holds."""

from swarmstart.ocp import SolutionStatus


def test_every_status_is_another_sentence() -> None:
    sentences = [status.value for status in SolutionStatus]
    assert len(set(sentences)) == len(sentences)
    assert all(len(sentence.split()) >= 5 for sentence in sentences)


def test_words_of_a_status_agree_with_whether_it_is_confirmed() -> None:
    for status in SolutionStatus:
        said = "confirmed on" in status.value
        assert said == status.is_confirmed
        refused = status.value.startswith("no")
        assert refused != status.is_confirmed
