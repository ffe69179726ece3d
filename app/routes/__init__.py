"""One file a subject: what each path takes and answers."""
