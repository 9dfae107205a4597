"""Series against a control variable: medians are where a diagnosis starts."""
