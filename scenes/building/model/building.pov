// A street on a clear day, the sun low on the left: two houses, a third across the end, trees, long shadows.
// Lambertian surfaces; the sky is evenly bright; a POV-Ray light colour is irradiance / pi.
// Declare=Layer=1 shows 1 / distance [1/m] instead, Declare=Layer=2 which thing each pixel shows.
#version 3.7;
#include "numbers.inc"
#ifndef (Layer) #declare Layer = 0; #end
global_settings {
  assumed_gamma 1 max_trace_level 12
  #if (Layer = 0)
    radiosity { count 300 nearest_count 6 error_bound 0.5 recursion_limit 2 pretrace_start 0.08 pretrace_end 0.01
                low_error_factor 0.6 gray_threshold 0 brightness 1 minimum_reuse 0.01 normal off }
  #end
}
background { rgb (Layer = 0 ? 1 : 0) * Sky_Radiance }
#declare Seed = seed(11);
#declare Tilt = radians(Camera_Pitch);
#declare Eye = <0, Camera_Height, 0>;
camera {
  perspective location Eye
  direction <0, sin(Tilt), -cos(Tilt)> * image_width / (2 * tan(radians(Field_Of_View / 2)))
  right x * image_width up <0, cos(Tilt), sin(Tilt)> * image_height
}
#declare To_Sun = <cos(radians(Sun_Elevation)) * sin(radians(Sun_Azimuth)), sin(radians(Sun_Elevation)),
                   -cos(radians(Sun_Elevation)) * cos(radians(Sun_Azimuth))>;
#if (Layer = 0)
  light_source { To_Sun * 1e4 rgb Sun_Irradiance / pi parallel point_at 0 }
#end

// Each thing has a number; Layer 2 shows it in red.
#macro Shown(Thing)
  #if (Layer = 1)
    pigment { function { min(1, 1 / sqrt(x*x + (y - Camera_Height)*(y - Camera_Height) + z*z)) } color_map { [0 rgb 0] [1 rgb 1] } }
    finish { ambient 0 diffuse 0 emission 1 }
  #end
  #if (Layer = 2) pigment { rgb <Thing, 0, 0> } finish { ambient 0 diffuse 0 emission 1 } #end
#end
#macro Surface(Pigment, Thing)
  #if (Layer = 0) pigment { Pigment } finish { ambient 0 diffuse 1 } #else Shown(Thing) #end
#end
// of a part of something that is moved: the whole is Shown after that, for a texture moves with its part
#macro Part(Albedo) #if (Layer = 0) pigment { rgb Albedo } finish { ambient 0 diffuse 1 } #end #end
#macro Plain(Albedo, Thing) Surface(pigment { rgb Albedo }, Thing) #end
#declare Granite_Mean = 0.424;   // of the pattern over the ground, averaged from a render: Albedo is the mean there
#macro Rough(Albedo, Size, Spread, Thing)
  Surface(pigment { granite scale Size color_map { [0 rgb Albedo * (1 - 2 * Spread * Granite_Mean)]
                                                   [1 rgb Albedo * (1 + 2 * Spread * (1 - Granite_Mean))] } }, Thing)
#end

// ---- ground: 1 -------------------------------------------------------------------------------------------
box { <-90, -1, -160>, <90, 0, 40> Rough(Asphalt_Albedo, 0.7, 0.25, 1) }
#declare Slabs = pigment { checker rgb Paving_Albedo * 1.04, rgb Paving_Albedo * 0.96 scale 0.6 }
box { <-90, -0.5, -End_From>, <Road_Left, Kerb, 40> Surface(Slabs, 1) }
box { <Road_Right, -0.5, -End_From>, <Lawn_From, Kerb, 40> Surface(Slabs, 1) }
box { <Lawn_From, -0.5, -End_From>, <90, Kerb, 40> Rough(Lawn_Albedo, 0.3, 0.35, 1) }
#for (I, 0, 16)
  box { <-0.16, 0, -4 - I * 3.6>, <-0.04, 0.003, -5.6 - I * 3.6> Plain(<0.62, 0.62, 0.60>, 1) }
#end

// ---- houses: left 2, right 3, end 4 -------------------------------------------------------------------------
// windows along a wall from <From> on, set back by 0.2 m and dark
#macro House(Low, High, Albedo, Thing)
  difference {
    box { Low, High }
    #for (Z, Low.z + 1.2, High.z - 2, 2.7)
      #for (Y, 1.1, High.y - 2.3, 3.1)
        box { <Low.x - 0.1, Y, Z>, <Low.x + 0.2, Y + 1.8, Z + 1.3> }
        box { <High.x - 0.2, Y, Z>, <High.x + 0.1, Y + 1.8, Z + 1.3> }
      #end
    #end
    #for (X, Low.x + 1.1, High.x - 2, 2.7)
      #for (Y, 1.1, High.y - 2.3, 3.1)
        box { <X, Y, High.z - 0.2>, <X + 1.3, Y + 1.8, High.z + 0.1> }
      #end
    #end
    Rough(Albedo, 1.6, 0.15, Thing)
  }
  box { Low + <0.21, 0, 0.21>, High - <0.21, 0.4, 0.21> Plain(<0.05, 0.055, 0.06>, Thing) }
  box { <Low.x - 0.25, High.y, Low.z - 0.25>, <High.x + 0.25, High.y + 0.35, High.z + 0.25> Rough(Albedo * 0.8, 0.9, 0.1, Thing) }
#end
House(<Left_Wall - 9, 0, -Left_To>, <Left_Wall, Left_Height, -Left_From>, Left_Albedo, 2)
House(<Right_Wall, 0, -Right_To>, <Right_Wall + 12, Right_Height, -Right_From>, Right_Albedo, 3)
House(<End_Left, 0, -End_From - 10>, <End_Right, End_Height, -End_From>, End_Albedo, 4)

// ---- trees: large 5, far 6 ----------------------------------------------------------------------------------
#macro Tree_At(Foot, Trunk, Radius, Leaves, Size, Thing)
  union {
    cone { 0, Radius * 0.10, y * (Trunk + Radius), Radius * 0.04 Part(<0.12, 0.09, 0.06>) }
    #for (I, 0, 8)
      #local A = 2 * pi * (I / 9 + 0.05 * rand(Seed)); #local R = Radius * (0.55 + 0.3 * rand(Seed));
      cone { y * (Trunk * 0.85 + 0.3 * Radius * rand(Seed)), Radius * 0.035,
             <R * cos(A), Trunk + Radius * (0.5 + 0.9 * rand(Seed)), R * sin(A)>, Radius * 0.01 Part(<0.12, 0.09, 0.06>) }
    #end
    union {
      #for (I, 1, Leaves)
        #local A = 2 * pi * rand(Seed); #local H = 2 * rand(Seed) - 1; #local R = Radius * pow(rand(Seed), 0.45);
        disc { 0, <rand(Seed) - 0.5, rand(Seed) - 0.2, rand(Seed) - 0.5>, Size * (0.6 + 0.8 * rand(Seed))
               translate <R * cos(A) * sqrt(1 - H * H), Trunk + 0.95 * Radius + 0.95 * R * H, R * sin(A) * sqrt(1 - H * H)> }
      #end
      Part(<0.13, 0.19, 0.055>)
    }
    translate Foot Shown(Thing)
  }
#end
Tree_At(Tree, 2.0, 2.3, 2600, 0.13, 5)
Tree_At(Far_Tree, 2.2, 2.6, 1800, 0.17, 6)

// ---- posts: tall 7, bollards 8 -------------------------------------------------------------------------------
union {
  cylinder { 0, y * Tall_Post_Height, 0.04 Part(0.25) }
  box { <-0.24, Tall_Post_Height - 0.5, 0.04>, <0.24, Tall_Post_Height - 0.02, 0.06> Part(<0.10, 0.22, 0.45>) }
  translate Tall_Post Shown(7)
}
#for (I, 0, 3)
  cylinder { 0, y * Bollard_Height, 0.07 Part(<0.35, 0.33, 0.30>) translate Bollard + <0, 0, -2.4 * I> Shown(8) }
#end

// ground truth in fog (make truth) brings the fog along, and takes another camera where it needs one
#ifdef (In_Fog) #include "in_fog.inc" #end
