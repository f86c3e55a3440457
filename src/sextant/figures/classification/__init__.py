"""Pictures of classifiers under corruptions."""
