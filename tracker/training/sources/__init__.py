"""Where pictures with boxes come from: published data sets, plain folders and tables, packed crops."""
