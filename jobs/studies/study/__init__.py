"""The library of the studies: options (options.py), running kiln (child.py), the folder of results and going on from
what it has (folder.py), sweeps of bakes (sweep.py, order.py), figures (figure.py), and files (exr.py, glb.py).

A study is a script beside this package. Its docstring says the question that it answers, its figure and its price; the
first line begins with "kiln bench NAME: " and is what `kiln bench --help` shows. The script ends with
`child.main(study)`. `kiln bench NAME` starts it with the path of kiln in the environment's KILN."""
