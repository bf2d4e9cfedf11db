"""Study: does a robot that starts at an unknown pose find its place in a saved map?"""
