"""scikit-learn's own checks, on every public estimator.

Clusterers take several views side by side, which no tag says; those checked here say
that theirs is one square kernel (see adapters.py).

An estimator of tracks cannot take the matrices that most checks feed: they have 1, 3 or
5 columns, where a track needs two a frame. Those failures are named here, and the same
checks pass through a subclass that reads any matrix as tracks (see adapters.py).
"""

from __future__ import annotations

import warnings

import pytest
from helpers.adapters import (
    AnyPerSequence,
    AnySampler,
    AnySegmenter,
    OneViewClustering,
    OneViewEigengap,
    OneViewNCRE,
    OneViewSelfTuning,
)
from sklearn.cluster import KMeans
from sklearn.utils import estimator_checks
from sklearn.utils.estimator_checks import check_estimator

from skmotionseg import (
    EigengapModelSelector,
    HypothesisSampler,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    ORKKernel,
    PerSequence,
    SelfTuningModelSelector,
)

SMALL = {"n_hypotheses": 20, "random_state": 0}
ENOUGH = {"n_hypotheses": 200, "random_state": 0}  # to tell three blobs apart

# Fed with 1, 2, 3 or 5 columns: no two frames of two columns each.
NOT_TRACKS = {
    "check_fit_score_takes_y",
    "check_estimators_overwrite_params",
    "check_dont_overwrite_parameters",
    "check_estimators_fit_returns_self",
    "check_readonly_memmap_input",
    "check_estimators_dtypes",
    "check_pipeline_consistency",
    "check_estimators_pickle",
    "check_f_contiguous_array_estimator",
    "check_methods_sample_order_invariance",
    "check_methods_subset_invariance",
    "check_fit2d_1feature",
    "check_dict_unchanged",
    "check_fit_idempotent",
    "check_fit_check_is_fitted",
    "check_n_features_in",
    "check_fit2d_predict1d",
}
NOT_TRACKS_TO_A_TRANSFORMER = {
    "check_transformer_data_not_an_array",
    "check_transformer_general",
    "check_transformer_preserve_dtypes",
}
# Fed with blobs, where rows are affinities.
NOT_AFFINITIES = {"check_clustering"}
# Fed with a matrix, where each sample is a matrix of its own.
NOT_SEQUENCES = NOT_TRACKS | {
    "check_n_features_in_after_fitting",
    "check_positive_only_tag_during_fit",
    "check_complex_data",
    "check_dtype_object",
    "check_estimators_empty_data_messages",
    "check_estimators_nan_inf",
    "check_fit2d_1sample",
}

CASES = {
    "HypothesisSampler": (
        HypothesisSampler(**SMALL),
        NOT_TRACKS | NOT_TRACKS_TO_A_TRANSFORMER,
    ),
    "HypothesisSampler, any matrix": (AnySampler(**SMALL), set()),
    "HypothesisSampler, fundamental, any matrix": (
        AnySampler("fundamental", **SMALL),
        set(),
    ),
    "ORKKernel": (ORKKernel(n_hypotheses=1), set()),
    "MultiModelSpectralClustering": (OneViewClustering(), NOT_AFFINITIES),
    "NCREModelSelector": (OneViewNCRE(max_clusters=3), NOT_AFFINITIES),
    "EigengapModelSelector": (OneViewEigengap(max_clusters=3), NOT_AFFINITIES),
    "SelfTuningModelSelector": (OneViewSelfTuning(max_clusters=3), NOT_AFFINITIES),
    "MotionSegmenter": (
        MotionSegmenter(max_motions=3, **SMALL),
        NOT_TRACKS | {"check_clustering"},
    ),
    # Of the two rules, the default one with the steps of a known number among its own.
    "MotionSegmenter, by NCRE, any matrix": (
        AnySegmenter(3, selection="ncre", **ENOUGH),
        set(),
    ),
    "MotionSegmenter, affine, count unknown, any matrix": (
        AnySegmenter(models=("affine",), max_motions=3, **ENOUGH),
        set(),
    ),
    "PerSequence": (PerSequence(MotionSegmenter(2, **SMALL)), NOT_SEQUENCES),
    # Each row is a scene to segment, whatever with, and a matrix has up to 150 rows.
    "PerSequence, any matrix": (
        AnyPerSequence(KMeans(2, n_init=1, random_state=0)),
        set(),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_scikit_learn_checks(case):
    estimator, expected = CASES[case]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # checks warn of what they skip
        results = check_estimator(estimator, on_fail=None)
    failed = {
        result["check_name"]: repr(result["exception"])
        for result in results
        if result["status"] == "failed"
    }
    assert len(results) > 40
    assert set(failed) == expected, failed


@pytest.mark.parametrize(
    "names", [NOT_TRACKS, NOT_TRACKS_TO_A_TRANSFORMER, NOT_AFFINITIES, NOT_SEQUENCES]
)
def test_expected_failures_name_real_checks(names):
    assert all(hasattr(estimator_checks, name) for name in names)


@pytest.mark.parametrize(
    "check", ["check_param_validation", "check_set_output_transform"]
)
@pytest.mark.parametrize(
    "case", [c for c, (_, failures) in CASES.items() if not failures]
)
def test_checks_that_check_estimator_leaves_out(case, check):
    estimator = CASES[case][0]
    getattr(estimator_checks, check)(type(estimator).__name__, estimator)


@pytest.mark.parametrize(
    "estimator",
    [
        MultiModelSpectralClustering(),
        NCREModelSelector(),
        EigengapModelSelector(),
        SelfTuningModelSelector(),
        PerSequence(None),
    ],
)
def test_parameters_are_validated(estimator):
    name = type(estimator).__name__
    if name != "PerSequence":
        estimator_checks.check_param_validation(name, estimator)
    else:
        with pytest.raises(ValueError, match="'estimator' parameter of PerSequence"):
            estimator.fit([[[0.0]]])


@pytest.mark.filterwarnings("ignore:X (has|does not have valid) feature names")
@pytest.mark.parametrize("estimator", [AnySampler(**SMALL), ORKKernel(n_hypotheses=1)])
@pytest.mark.parametrize(
    "check",
    [
        "check_transformer_get_feature_names_out",
        "check_transformer_get_feature_names_out_pandas",
        "check_set_output_transform_pandas",
        "check_global_output_transform_pandas",
    ],
)
def test_transformers_name_their_columns(estimator, check):
    getattr(estimator_checks, check)(type(estimator).__name__, estimator)


@pytest.mark.parametrize(
    "estimator",
    [
        AnySampler(**SMALL),
        ORKKernel(n_hypotheses=1),
        AnySegmenter(selection="ncre", **SMALL),
    ],
)
def test_dataframe_columns_are_remembered(estimator):
    estimator_checks.check_dataframe_column_names_consistency(
        type(estimator).__name__, estimator
    )
