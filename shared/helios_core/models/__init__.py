"""Model weights on this machine.

catalogue.py     the models that the documents recommend
model_folder.py  the folder of fetched models, with its lock file
"""
