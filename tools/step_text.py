"""Text of a STEP file of a polyhedron."""

import numpy as np

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));
ENDSEC;
DATA;
"""


class _Entities:
    def __init__(self):
        self.lines = []

    def add(self, text):
        self.lines.append(f'#{len(self.lines) + 1}={text};')
        return f'#{len(self.lines)}'

    def place(self, point, axis, direction):
        vectors = [self.add(f"DIRECTION('',{_numbers(v)})") for v in (axis, direction)]
        return self.add(f"AXIS2_PLACEMENT_3D('',{self.point(point)},{','.join(vectors)})")

    def point(self, xyz):
        return self.add(f"CARTESIAN_POINT('',{_numbers(xyz)})")


def _numbers(values):
    return '(' + ','.join(f'{float(v):.9f}' for v in values) + ')'


def step_text(corners, faces, unit='.MILLI.'):
    """Return a STEP file of a solid with planar faces, lists of corners seen from outside."""
    e = _Entities()
    corners = np.asarray(corners, dtype=float)
    vertices = [e.add(f"VERTEX_POINT('',{e.point(c)})") for c in corners]
    edges = {}
    found = []
    for face in faces:
        loop = []
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            key = (min(a, b), max(a, b))
            if key not in edges:
                way = corners[key[1]] - corners[key[0]]
                size = float(np.linalg.norm(way))
                vector = e.add(f"DIRECTION('',{_numbers(way / size)})")
                vector = e.add(f"VECTOR('',{vector},{size:.9f})")
                line = e.add(f"LINE('',{e.point(corners[key[0]])},{vector})")
                edges[key] = e.add(
                    f"EDGE_CURVE('',{vertices[key[0]]},{vertices[key[1]]},{line},.T.)"
                )
            sense = '.T.' if (a, b) == key else '.F.'
            loop.append(e.add(f"ORIENTED_EDGE('',*,*,{edges[key]},{sense})"))
        bound = e.add(f"EDGE_LOOP('',({','.join(loop)}))")
        bound = e.add(f"FACE_OUTER_BOUND('',{bound},.T.)")
        one, two = corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[0]]
        normal = np.cross(one, two)
        place = e.place(
            corners[face[0]], normal / np.linalg.norm(normal), one / np.linalg.norm(one)
        )
        plane = e.add(f"PLANE('',{place})")
        found.append(e.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    shell = e.add(f"CLOSED_SHELL('',({','.join(found)}))")
    solid = e.add(f"MANIFOLD_SOLID_BREP('',{shell})")
    length = e.add(f'(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({unit},.METRE.))')
    angle = e.add('(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))')
    solid_angle = e.add('(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())')
    error = e.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{length},'','')")
    context = e.add(
        '(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(('
        f'{error}))GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{solid_angle}))'
        "REPRESENTATION_CONTEXT('',''))"
    )
    origin = e.place((0, 0, 0), (0, 0, 1), (1, 0, 0))
    shape = e.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({origin},{solid}),{context})")
    application = e.add("APPLICATION_CONTEXT('automotive design')")
    e.add(
        "APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,"
        f'{application})'
    )
    product_context = e.add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
    product = e.add(f"PRODUCT('part','part','',({product_context}))")
    formation = e.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    design = e.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
    definition = e.add(f"PRODUCT_DEFINITION('design','',{formation},{design})")
    definition = e.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    e.add(f'SHAPE_DEFINITION_REPRESENTATION({definition},{shape})')
    return HEAD + '\n'.join(e.lines) + '\nENDSEC;\nEND-ISO-10303-21;\n'
