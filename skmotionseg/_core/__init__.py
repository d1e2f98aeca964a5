"""The method as functions of arrays, which know nothing of estimators."""
