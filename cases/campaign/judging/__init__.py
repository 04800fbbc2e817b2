"""Judgements of many trials: statistics, words, tables, regressions."""
