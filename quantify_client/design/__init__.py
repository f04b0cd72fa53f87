"""Design surfaces: triangles from LandXML and DXF."""
